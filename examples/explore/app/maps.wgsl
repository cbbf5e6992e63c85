// A shadow map, small, with as much contrast as its depths allow.

@group(0) @binding(0) var depths: texture_depth_2d;
// Texels of the map (none if nothing is in it), and pixels that it is shown on.
@group(0) @binding(1) var<uniform> sizes: vec4<u32>;

// The nearest and the farthest caster are looked for at so many places along a side.
const PLACES: u32 = 48u;
// Loads along a side of a pixel.
const LOADS: u32 = 4u;
const CLEARED = vec4<f32>(0.004, 0.008, 0.06, 1.0);

struct Corner {
    @builtin(position) position: vec4<f32>,
    @location(0) uv: vec2<f32>,
    @location(1) @interpolate(flat) extent: vec2<f32>,
}

fn depth_at(texel: vec2<f32>) -> f32 {
    let last = vec2<f32>(sizes.xy) - 1.0;
    return textureLoad(depths, vec2<i32>(clamp(texel, vec2<f32>(0.0), last)), 0);
}

// Where nothing is drawn, depth is 0.
fn extent_of_depths() -> vec2<f32> {
    var extent = vec2<f32>(1.0, 0.0);
    if (sizes.x == 0u) {
        return extent;
    }
    let apart = vec2<f32>(sizes.xy) / f32(PLACES);
    for (var i = 0u; i < PLACES * PLACES; i += 1u) {
        let place = vec2<f32>(f32(i % PLACES), f32(i / PLACES)) + 0.5;
        let depth = depth_at(place * apart);
        if (depth > 0.0) {
            extent = vec2<f32>(min(extent.x, depth), max(extent.y, depth));
        }
    }
    return extent;
}

@vertex
fn vertex(@builtin(vertex_index) index: u32) -> Corner {
    let uv = vec2<f32>(f32((index << 1u) & 2u), f32(index & 2u));
    var corner: Corner;
    corner.position = vec4<f32>(2.0 * uv.x - 1.0, 1.0 - 2.0 * uv.y, 0.0, 1.0);
    corner.uv = uv;
    corner.extent = extent_of_depths();
    return corner;
}

@fragment
fn fragment(corner: Corner) -> @location(0) vec4<f32> {
    if (sizes.x == 0u) {
        return CLEARED;
    }
    let texels = vec2<f32>(sizes.xy);
    let pixel = texels / vec2<f32>(sizes.zw);
    let first = corner.uv * texels - 0.5 * pixel;
    var nearest = 0.0;
    for (var i = 0u; i < LOADS * LOADS; i += 1u) {
        let place = vec2<f32>(f32(i % LOADS), f32(i / LOADS)) + 0.5;
        nearest = max(nearest, depth_at(first + place * pixel / f32(LOADS)));
    }
    if (nearest == 0.0) {
        return CLEARED;
    }
    let height = (nearest - corner.extent.x) / max(corner.extent.y - corner.extent.x, 1e-6);
    let gray = pow(mix(0.25, 1.0, clamp(height, 0.0, 1.0)), 2.2);
    return vec4<f32>(vec3<f32>(gray), 1.0);
}
