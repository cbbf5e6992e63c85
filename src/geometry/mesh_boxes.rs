//! Boxes around a surface's parts: how a large mesh, a terrain of one piece, is known better than by
//! one box.

use glam::{UVec2, Vec2, Vec3};

/// A box between two corners.
pub type Corners = [Vec3; 2];

/// Triangles in a part, about.
const TRIANGLES: f32 = 128.0;

/// A surface has at most so many parts along a side.
const MAX_PER_SIDE: u32 = 32;

/// The boxes of a surface's parts, which together hold all its triangles: columns along its bounds'
/// shortest side, over squares of the other two. Each triangle is wholly in the part that its middle
/// is in. Parts without triangles are left out, and triangles that are not finite.
pub fn part_boxes<I: Iterator<Item = [Vec3; 3]>>(triangles: impl Fn() -> I) -> Vec<Corners> {
    let finite = || triangles().filter(|corners| corners.iter().all(|corner| corner.is_finite()));
    let (bounds, count) = finite().fold((NOTHING, 0_u32), |(bounds, count), triangle| {
        (grown(bounds, triangle), count.saturating_add(1))
    });
    let size = bounds[1] - bounds[0];
    let sides = if size.min_element() == size.y {
        [0, 2]
    } else if size.min_element() == size.x {
        [1, 2]
    } else {
        [0, 1]
    };
    let flat = |point: Vec3| Vec2::new(point[sides[0]], point[sides[1]]);
    let (start, extent) = (flat(bounds[0]), flat(size));
    let square = (extent.x * extent.y * TRIANGLES / count as f32).sqrt();
    if !(square > 0.0 && square.is_finite()) {
        return if count > 0 { vec![bounds] } else { Vec::new() };
    }
    let most = UVec2::splat(MAX_PER_SIDE);
    let cells = (extent / square).ceil().as_uvec2().clamp(UVec2::ONE, most);
    let mut found = vec![NOTHING; (cells.x * cells.y) as usize];
    for triangle in finite() {
        let middle = flat(triangle.iter().sum::<Vec3>() / 3.0);
        let share = (middle - start) / extent;
        let cell = (share * cells.as_vec2()).as_uvec2().min(cells - 1);
        let part = &mut found[(cell.y * cells.x + cell.x) as usize];
        *part = grown(*part, triangle);
    }
    found.retain(|part| *part != NOTHING);
    found
}

const NOTHING: Corners = [Vec3::INFINITY, Vec3::NEG_INFINITY];

fn grown([lo, hi]: Corners, triangle: [Vec3; 3]) -> Corners {
    triangle.iter().fold([lo, hi], |[lo, hi], corner| {
        [lo.min(*corner), hi.max(*corner)]
    })
}
