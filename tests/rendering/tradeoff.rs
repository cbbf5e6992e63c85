//! The measuring tool measured: rays against known answers, planted faults found, everything
//! repeatable, predictions kept.

use bevy::{
    asset::RenderAssetUsages,
    camera::visibility::NoFrustumCulling,
    light::ShadowFilteringMethod,
    math::DVec3,
    mesh::{
        VertexAttributeValues,
        skinning::{SkinnedMesh, SkinnedMeshInverseBindposes},
    },
    prelude::*,
    render::render_resource::{Extent3d, TextureDimension, TextureFormat},
};
use bevy_pssm::{ShadowPlans, prelude::*};

use crate::{
    pareto::{Axis, front},
    scene::ScenesPlugin,
    scene_stage::SceneStage,
    stage::take_turn,
    study::{
        drawn::{Drawn, percent},
        gather::{Geometry, Surface},
        path::Path,
        paths::Route,
        pictures,
        row::{COLUMNS, Row},
        run::{Effort, Outcome, View},
        settings::{Setting, Stock},
        studio::{Stance, Studio, linear_camera, measurable_app},
        trace::{Lens, Rays, Tracer},
    },
};

const SIZE: UVec2 = UVec2::new(240, 180);

/// A scene of meshes, without a GPU.
fn geometry(meshes: Vec<(Mesh, Transform)>) -> Geometry {
    let mut geometry = Geometry::default();
    for (index, (mesh, place)) in meshes.into_iter().enumerate() {
        geometry.surfaces.push(Surface::plain());
        for triangle in mesh.triangles().expect("a triangle list") {
            let corners = triangle.vertices.map(|p| place.transform_point(p));
            geometry.triangles.push(corners);
            geometry.surface_of.push(index as u32);
        }
    }
    geometry
}

fn ground(at: Vec3) -> (Mesh, Transform) {
    let mesh = Plane3d::default().mesh().size(60.0, 60.0).build();
    (mesh, Transform::from_translation(at))
}

/// Looks straight down on a square of so many meters.
fn from_above(at: Vec3, side: f64, pixels: u32) -> Lens {
    let view_from_world = glam::dcamera::rh::view::look_to_mat4(
        at.as_dvec3() + DVec3::Y * 50.0,
        DVec3::NEG_Y,
        DVec3::NEG_Z,
    );
    let half = 0.5 * side;
    // Reverse z.
    let clip_from_view =
        glam::dcamera::rh::proj::directx::orthographic(-half, half, -half, half, 100.0, 0.1);
    Lens {
        clip_from_world: clip_from_view * view_from_world,
        size: UVec2::splat(pixels),
    }
}

/// Area of the ground that is seen and in shadow (square meters), by whole pixels and by shares.
fn dark_area(tracer: &Tracer, lens: &Lens, side: f64, to_sun: DVec3) -> [f64; 2] {
    let samples = tracer.picture(lens, to_sun);
    let shares = tracer.shares(lens, to_sun, &samples, Rays::at_edges(4));
    let pixel = (side / f64::from(lens.size.x)).powi(2);
    let on_ground = |i: &usize| samples[*i].is_some_and(|s| s.normal.y > 0.999 && s.triangle < 2);
    let ground: Vec<usize> = (0..samples.len()).filter(on_ground).collect();
    let dark = ground
        .iter()
        .filter(|i| samples[**i].is_some_and(|s| !s.lit));
    let shade: f64 = ground
        .iter()
        .filter_map(|i| shares[*i])
        .map(|share| 1.0 - f64::from(share))
        .sum();
    [dark.count() as f64 * pixel, shade * pixel]
}

#[test]
fn a_box_on_a_plane_shades_what_geometry_says() {
    let (a, b, h) = (4.0, 2.5, 3.0);
    for origin in [Vec3::ZERO, Vec3::new(900.0, 0.0, -700.0)] {
        let block = Cuboid::new(a as f32, h as f32, b as f32).mesh().build();
        let stands = Transform::from_translation(origin + Vec3::Y * 0.5 * h as f32);
        let tracer = Tracer::new(geometry(vec![ground(origin), (block, stands)]));
        for to_sun in [DVec3::new(0.5, 0.8, 0.3), DVec3::new(-1.0, 0.4, 0.2)] {
            let to_sun = to_sun.normalize();
            // Off the grid, or whole rows of pixels would fall to one side of an edge.
            let lens = from_above(origin + Vec3::new(0.013, 0.0, 0.021), 30.0, 600);
            // The base, swept along the shadow of an upright edge, less the base itself.
            let sweep = h / to_sun.y * DVec3::new(to_sun.x, 0.0, to_sun.z);
            let expected = a * sweep.z.abs() + b * sweep.x.abs();
            let [whole, shares] = dark_area(&tracer, &lens, 30.0, to_sun);
            approx::assert_relative_eq!(whole, expected, max_relative = 0.02);
            // A pixel at the foot of the box counts as ground whole.
            approx::assert_relative_eq!(shares, expected, max_relative = 0.02);
        }
    }
}

#[test]
fn a_ball_over_a_plane_shades_an_ellipse() {
    let radius = 1.5;
    let ball = Sphere::new(radius as f32).mesh().uv(256, 128);
    let hangs = Transform::from_xyz(-6.0, 6.0, 0.0);
    let tracer = Tracer::new(geometry(vec![ground(Vec3::ZERO), (ball, hangs)]));
    let to_sun = DVec3::new(-0.9, 0.7, 0.1).normalize();
    let expected = core::f64::consts::PI * radius * radius / to_sun.y;
    let [whole, shares] = dark_area(&tracer, &from_above(Vec3::ZERO, 24.0, 600), 24.0, to_sun);
    approx::assert_relative_eq!(whole, expected, max_relative = 0.01);
    approx::assert_relative_eq!(shares, expected, max_relative = 0.004);
}

#[test]
fn shadows_reach_to_the_contact_and_no_surface_shades_itself() {
    // A kilometer out; a box, and a ball whose facets all but face each other.
    let origin = Vec3::new(1000.0, 3.0, -1000.0);
    let block = Cuboid::new(2.0, 1.0, 2.0).mesh().build();
    let ball = Sphere::new(1.0).mesh().uv(64, 32);
    let tracer = Tracer::new(geometry(vec![
        ground(origin),
        (block, Transform::from_translation(origin + Vec3::Y * 0.5)),
        (
            ball,
            Transform::from_translation(origin + Vec3::new(6.0, 4.0, 0.0)),
        ),
    ]));
    let to_sun = DVec3::new(1.0, 1.0, 0.0).normalize();
    // Two centimeters along the wall on the side away from the sun, at 0.2 mm a pixel.
    let at = origin + Vec3::new(-1.01, 0.0, 0.0);
    let samples = tracer.picture(&from_above(at, 0.02, 100), to_sun);
    let ground = samples.iter().flatten().filter(|s| s.triangle < 2);
    let lit = ground.clone().filter(|s| s.lit).count();
    assert!(ground.count() > 4000, "the ground is in the picture");
    // Vertices a kilometer out are rounded to 0.06 mm, and rays start a millimeter up.
    assert!(lit <= 100 * 6, "{lit} of 10,000 pixels are lit");
    // Nothing shades the sunny side of the ball.
    let over_ball = from_above(origin + Vec3::new(6.0, 0.0, 0.0), 2.0, 200);
    let samples = tracer.picture(&over_ball, to_sun);
    let facing = samples
        .iter()
        .flatten()
        .filter(|s| s.triangle >= 14 && s.faces_sun);
    assert!(facing.clone().count() > 10_000);
    assert_eq!(facing.filter(|s| !s.lit).count(), 0);
}

/// Ground, a wall, a ball and posts, under a sun.
fn studio(filter: ShadowFilteringMethod) -> Studio {
    let mut headless = measurable_app(SIZE, |_| ());
    let target = headless.render_target();
    let world = headless.app.world_mut();
    world.insert_resource(GlobalAmbientLight::NONE);
    let mut meshes = world.resource_mut::<Assets<Mesh>>();
    let ground = meshes.add(Plane3d::default().mesh().size(200.0, 200.0));
    let wall = meshes.add(Cuboid::new(6.0, 3.0, 0.4));
    let ball = meshes.add(Sphere::new(1.2).mesh().uv(48, 24));
    let post = meshes.add(Cuboid::new(0.3, 4.0, 0.3));
    let paint = world
        .resource_mut::<Assets<StandardMaterial>>()
        .add(StandardMaterial {
            perceptual_roughness: 1.0,
            reflectance: 0.0,
            ..default()
        });
    let mut spawn = |mesh: &Handle<Mesh>, place: Transform| {
        world.spawn((Mesh3d(mesh.clone()), MeshMaterial3d(paint.clone()), place));
    };
    spawn(&ground, Transform::default());
    spawn(
        &wall,
        Transform::from_xyz(-2.0, 1.5, -6.0).with_rotation(Quat::from_rotation_y(0.5)),
    );
    spawn(&ball, Transform::from_xyz(2.5, 1.2, -4.0));
    for i in 0..8 {
        let i = i as f32;
        spawn(
            &post,
            Transform::from_xyz(-6.0 + 2.0 * i, 2.0, -9.0 - 3.0 * i),
        );
    }
    let sun = world
        .spawn((
            DirectionalLight {
                illuminance: 3000.0,
                ..default()
            },
            ParallelSplitShadows::default(),
            Transform::from_xyz(-4.0, 3.0, -3.0).looking_at(Vec3::ZERO, Vec3::Y),
        ))
        .id();
    let eye = Transform::from_xyz(0.0, 4.0, 8.0).looking_at(Vec3::new(0.0, 0.0, -6.0), Vec3::Y);
    let camera = world
        .spawn((Camera3d::default(), target, eye, filter, linear_camera()))
        .id();
    Studio::new(headless, camera, sun, SIZE)
}

fn survey(studio: &mut Studio, steps: usize) -> Vec<View> {
    let effort = Effort {
        rays: Rays::at_edges(4),
        flicker_poses: 1,
        steps,
    };
    let stance = studio.stance();
    studio.survey(&[stance], effort, || ())
}

fn config(map_size: u32, fit: CascadeFit) -> ParallelSplitShadows {
    ParallelSplitShadows {
        cascades: 2,
        far: 60.0,
        map_size: MapSize::Same(map_size),
        fit,
        ..default()
    }
}

fn keep(name: &str, view: &View, outcome: &Outcome) {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/target/test-pictures");
    let picture = pictures::difference(&view.truth, &outcome.shots[0].shares);
    std::fs::create_dir_all(folder)
        .and_then(|()| {
            let file = format!("{folder}/tradeoff_{name}.png");
            picture.save(file).map_err(std::io::Error::other)
        })
        .expect("pictures can be written");
}

#[test]
fn planted_faults_are_found() {
    let _turn = take_turn();
    let mut studio = studio(ShadowFilteringMethod::Gaussian);
    let views = survey(&mut studio, 2);
    let mut measure = |name: &str, config: ParallelSplitShadows, biases: Option<[f32; 2]>| {
        let setting = Setting::pssm(name, config);
        studio.apply(&setting);
        let sun = studio.sun;
        if let (Some([depth, normal]), Some(mut light)) =
            (biases, studio.world().get_mut::<DirectionalLight>(sun))
        {
            light.shadow_depth_bias = depth;
            light.shadow_normal_bias = normal;
        }
        let outcome = studio.observe(&views, &setting, || ());
        keep(name, &views[0], &outcome);
        outcome
    };
    let sound = measure("sound", config(2048, CascadeFit::Stable), None);
    let figures = sound.figures;
    assert!(figures.wrong_pct < 1.5, "{figures:?}");
    assert!(figures.stain_pct < 0.5, "{figures:?}");
    approx::assert_relative_eq!(
        figures.wrong_pct,
        figures.acne_pct + figures.leak_pct,
        max_relative = 1e-9
    );

    // With no bias about half of each filter is in shadow, so surfaces are stained all over; how many
    // pixels are more than half wrong, rounding decides. Away from the light most are.
    let constant = |meters| {
        let mut config = config(2048, CascadeFit::Stable);
        config.comparison.bias = ShadowBias::Constant { meters };
        config
    };
    let unbiased = measure("no_bias", constant(0.0), None);
    assert!(
        unbiased.figures.stain_pct > figures.stain_pct + 50.0,
        "{:?}",
        unbiased.figures
    );
    let away = Some([-0.02, 1.8]);
    let unbiased = measure("away_bias", constant(0.1), away);
    assert!(
        unbiased.figures.acne_pct > figures.acne_pct + 5.0,
        "{:?}",
        unbiased.figures
    );
    let detached = measure(
        "huge_bias",
        config(2048, CascadeFit::Stable),
        Some([2.0, 1.8]),
    );
    assert!(
        detached.figures.leak_pct > figures.leak_pct + 1.0,
        "{:?}",
        detached.figures
    );
    let coarse = measure("coarse", config(64, CascadeFit::Stable), None);
    assert!(
        coarse.figures.edge_px_p95 > figures.edge_px_p95 + 5.0,
        "{:?} against {figures:?}",
        coarse.figures
    );
    assert!(
        coarse.figures.mae_pct > figures.mae_pct,
        "{:?}",
        coarse.figures
    );

    // A map that follows the lens or the sun must change; under the camera's other motions a
    // snapped one rests, at any size.
    let flips = |outcome: &Outcome| -> usize { outcome.flips[..2].iter().map(|f| f.flipped).sum() };
    let followed: usize = sound.flips[..2].iter().map(|flips| flips.followed).sum();
    assert!(followed > 50_000, "{followed}");
    for size in [256, 2048] {
        let snapped = measure("snapped", config(size, CascadeFit::Stable), None);
        assert_eq!(flips(&snapped), 0, "{:?}", snapped.flips);
        let loose = ParallelSplitShadows {
            slack: 0.0,
            ..config(size, CascadeFit::Tight)
        };
        let unsnapped = measure("unsnapped", loose, None);
        assert!(flips(&unsnapped) > 20, "{:?}", unsnapped.flips);
    }
}

/// Points and grids hold at rest and under the default; maps laid anew in each frame are found out.
#[test]
fn what_does_not_keep_still_along_a_path_is_found() {
    let _turn = take_turn();
    let mut studio = studio(ShadowFilteringMethod::Hardware2x2);
    let pose = [studio.stance()];
    let tracer = studio.tracer(&pose[0]);
    let [rest, turn] = [Path::Rest, Path::Turn(30.0)]
        .map(|path| studio.explore(path, 120, &tracer, &pose, &|_, _| f32::NEG_INFINITY));
    let mut along = |route: &Route, config: ParallelSplitShadows| {
        let setting = Setting::pssm("a", config);
        studio.apply(&setting);
        studio.travel(route, &setting, || ())
    };
    let steady = config(1024, CascadeFit::Steady);
    // Coarse, and laid anew in each frame.
    let jumping = ParallelSplitShadows {
        slack: 0.0,
        ..config(64, CascadeFit::Tight)
    };
    let found = along(&rest, steady.clone());
    assert_eq!((found.changed_pct, found.grid_changes), (0.0, 0));
    assert!(found.wrong_pct > 0.0 && found.wrong_pct < 1.0, "{found:?}");
    // The first frame's, of six hundred.
    let Drawn {
        always, still, all, ..
    } = found.drawn;
    assert_eq!(
        (600 * still.maps, 600 * still.casters, 600 * still.texels),
        (always.maps, always.casters, always.texels)
    );
    assert_eq!(always.texels, always.maps as u64 * 1024 * 1024);
    // In the others, what moves is drawn over copies.
    assert!(all.casters > always.casters / 2, "{found:?}");
    assert!(
        all.texels > always.texels / 2 && all.texels <= always.texels + still.texels,
        "{found:?}"
    );
    let found = along(&turn, steady);
    let drawn = percent(found.drawn.still.triangles, found.drawn.always.triangles);
    assert!(drawn > 0.2 && drawn < 30.0, "{found:?}");
    assert!(found.grid_changes < 10, "{found:?}");
    let most = found.changed_pct.max(0.1);
    assert!(most < 0.5, "{found:?}");
    let planted = along(&turn, jumping);
    assert!(planted.grid_changes > 200, "{planted:?}");
    assert!(planted.changed_pct > 4.0 * most, "{planted:?}");
}

/// The tool's idea of the scene is what the GPU draws: if only the GPU's is changed, the two
/// disagree.
#[test]
fn masks_and_skins_are_traced_as_drawn() {
    let _turn = take_turn();
    let mut studio = studio(ShadowFilteringMethod::Gaussian);
    let world = studio.world();
    let mask = Image::new(
        Extent3d {
            width: 4,
            height: 4,
            depth_or_array_layers: 1,
        },
        TextureDimension::D2,
        (0..16_u8)
            .flat_map(|i| [255, 255, 255, 255 * ((i % 4 / 2 + i / 8) % 2)])
            .collect(),
        TextureFormat::Rgba8UnormSrgb,
        RenderAssetUsages::default(),
    );
    let mask = world.resource_mut::<Assets<Image>>().add(mask);
    let fence = world
        .resource_mut::<Assets<StandardMaterial>>()
        .add(StandardMaterial {
            base_color_texture: Some(mask),
            alpha_mode: AlphaMode::Mask(0.5),
            cull_mode: None,
            double_sided: true,
            ..default()
        });
    let mesh = world
        .resource_mut::<Assets<Mesh>>()
        .add(Rectangle::new(5.0, 4.0));
    world.spawn((
        Mesh3d(mesh),
        MeshMaterial3d(fence.clone()),
        Transform::from_xyz(-3.0, 2.0, 0.0).looking_to(Vec3::new(0.9, 0.0, 0.4), Vec3::Y),
    ));

    let post = Cuboid::new(0.6, 4.0, 0.6)
        .mesh()
        .build()
        .translated_by(Vec3::Y * 2.0);
    let Some(VertexAttributeValues::Float32x3(corners)) = post.attribute(Mesh::ATTRIBUTE_POSITION)
    else {
        panic!("a mesh has positions");
    };
    let joints: Vec<[u16; 4]> = corners
        .iter()
        .map(|p| [u16::from(p[1] > 1.0), 0, 0, 0])
        .collect();
    let weights = vec![[1.0, 0.0, 0.0, 0.0]; joints.len()];
    let post = post
        .with_inserted_attribute(
            Mesh::ATTRIBUTE_JOINT_INDEX,
            VertexAttributeValues::Uint16x4(joints),
        )
        .with_inserted_attribute(Mesh::ATTRIBUTE_JOINT_WEIGHT, weights);
    let post = world.resource_mut::<Assets<Mesh>>().add(post);
    let inverse_bindposes = world
        .resource_mut::<Assets<SkinnedMeshInverseBindposes>>()
        .add(vec![Mat4::IDENTITY; 2]);
    let paint = world
        .resource_mut::<Assets<StandardMaterial>>()
        .add(StandardMaterial::default());
    let foot = world.spawn(Transform::from_xyz(1.5, 0.0, 0.0)).id();
    let head = world.spawn(Transform::from_xyz(2.9, 0.0, 0.4)).id();
    world.spawn((
        Mesh3d(post),
        MeshMaterial3d(paint),
        Transform::default(),
        NoFrustumCulling,
        SkinnedMesh {
            inverse_bindposes,
            joints: vec![foot, head],
        },
    ));

    let views = survey(&mut studio, 0);
    let setting = Setting::pssm("masked", config(4096, CascadeFit::Stable));
    let drawn = studio.measure(&views, &setting, || ());
    keep("masked", &views[0], &drawn);
    let wrong = drawn.figures.wrong_pct;
    assert!(wrong < 1.0, "{:?}", drawn.figures);
    let dark = views[0]
        .truth
        .samples
        .iter()
        .flatten()
        .filter(|s| s.faces_sun && !s.lit);
    assert!(dark.count() > 2000);

    let mut materials = studio.world().resource_mut::<Assets<StandardMaterial>>();
    materials.get_mut(&fence).expect("it is there").alpha_mode = AlphaMode::Opaque;
    let closed = studio.observe(&views, &setting, || ()).figures.wrong_pct;
    assert!(closed > wrong + 0.5, "{closed} against {wrong}");
    studio
        .world()
        .entity_mut(head)
        .insert(Transform::from_xyz(1.5, 0.0, 0.0));
    let straight = studio.observe(&views, &setting, || ()).figures.wrong_pct;
    assert!(straight > closed + 0.3, "{straight} against {closed}");
}

#[test]
fn everything_but_times_repeats_exactly() {
    let _turn = take_turn();
    let size = UVec2::new(160, 120);
    let coarse = ParallelSplitShadows {
        far: 800.0,
        ..config(64, CascadeFit::Tight)
    };
    let settings = [
        Setting::pssm("tight", coarse.clone()),
        Setting::bevy("bevy", Stock::new(256, &coarse)),
    ];
    // Each setting twice, the other in between, from two poses in this order.
    let outcomes = |poses: [usize; 2]| -> Vec<(Row, Outcome)> {
        let app = measurable_app(size, |app| {
            app.add_plugins(ScenesPlugin);
        });
        let stage = SceneStage::in_app(app, linear_camera(), |world, current| {
            current.load("huge_chessboard", world.resource::<AssetServer>());
        });
        let stage = stage.expect("it loads");
        let places = poses.map(|pose| stage.pose(pose));
        let mut studio = Studio::new(stage.headless, stage.camera, stage.sun, size);
        let start = studio.stance();
        let stances = places.map(|camera| Stance {
            camera,
            ..start.clone()
        });
        let effort = Effort {
            rays: Rays::at_edges(2),
            flicker_poses: 1,
            steps: 1,
        };
        let views = studio.survey(&stances, effort, || ());
        [0, 1, 0, 1]
            .map(|index| {
                let outcome = studio.measure(&views, &settings[index], || ());
                let row = Row::new("huge_chessboard", &outcome, 2).without_times();
                (row, outcome)
            })
            .into()
    };
    let (first, second) = (outcomes([0, 1]), outcomes([1, 0]));
    for index in [0, 1] {
        assert_eq!(first[index].0, first[index + 2].0);
        let (row, other) = (&first[index].0, &second[index].0);
        assert_eq!(
            (row.wrong_pct, row.stain_pct, row.mae_pct, row.edge_px_p95),
            (
                other.wrong_pct,
                other.stain_pct,
                other.mae_pct,
                other.edge_px_p95
            ),
        );
        assert_eq!(
            (
                row.shadow_vertices,
                row.shadow_fragments,
                row.main_fragments
            ),
            (
                other.shadow_vertices,
                other.shadow_fragments,
                other.main_fragments
            ),
        );
        // Counts are those of their own pose, whichever came first.
        let counts = |outcome: &Outcome, pose: usize| {
            let gpu = outcome.frames[pose].gpu;
            [
                gpu.vertices,
                gpu.primitives,
                gpu.fragments,
                gpu.main_fragments,
            ]
        };
        let (forth, back) = (&first[index].1, &second[index].1);
        assert_eq!(counts(forth, 0), counts(back, 1));
        assert_ne!(counts(forth, 0), counts(forth, 1));

        assert!(row.wrong_pct > 0.0, "{row:?}");
        assert!(
            row.shadow_vertices > 0 && row.shadow_primitives > 0,
            "{row:?}"
        );
        // What is seen is part of what is predicted for.
        assert!(
            row.predicted_texels_per_pixel <= row.seen_texels_per_pixel + 1e-3,
            "{row:?}"
        );
    }
}

#[test]
fn columns_are_the_documented_ones() {
    let mut csv = csv::Writer::from_writer(Vec::new());
    csv.serialize(Row::default()).expect("a row is plain");
    let text = String::from_utf8(csv.into_inner().expect("flushed")).expect("text");
    let header: Vec<&str> = text.lines().next().unwrap_or_default().split(',').collect();
    assert_eq!(header, COLUMNS.map(|(name, _)| name));
}

#[test]
fn a_front_has_what_nothing_dominates() {
    let row = |mib, wrong_pct| Row {
        mib,
        wrong_pct,
        ..Row::default()
    };
    let rows = [
        row(4.0, 3.0),
        row(1.0, 5.0),
        row(4.0, 2.0),
        row(9.0, 2.0),
        row(16.0, 1.0),
    ];
    assert_eq!(front(&rows, Axis::Memory), [1, 2, 4]);
    // All cost no time: the best of all remains.
    assert_eq!(front(&rows, Axis::Time), [4]);
}

/// A straight edge of a shadow across the picture's columns, under a sun overhead. The hardware
/// filter turns a texel into a ramp of light as wide as the texel: the ramp's slope is the
/// texels that a pixel gets.
#[test]
fn predictions_bound_what_a_ground_plane_shows() {
    let _turn = take_turn();
    let mut studio = studio(ShadowFilteringMethod::Hardware2x2);
    let world = studio.world();
    let casters: Vec<Entity> = world
        .query_filtered::<(Entity, &Transform), With<Mesh3d>>()
        .iter(world)
        .filter(|(_, place)| place.translation.y > 0.0)
        .map(|(entity, _)| entity)
        .collect();
    for caster in casters {
        world.despawn(caster);
    }
    // A roof over the right half: its edge's shadow runs along the view.
    let roof = world
        .resource_mut::<Assets<Mesh>>()
        .add(Cuboid::new(40.0, 0.1, 120.0));
    let material = world
        .resource_mut::<Assets<StandardMaterial>>()
        .add(StandardMaterial::default());
    world.spawn((
        Mesh3d(roof),
        MeshMaterial3d(material),
        Transform::from_xyz(20.13, 12.0, 0.0),
    ));
    let (sun, camera) = (studio.sun, studio.camera);
    let world = studio.world();
    world
        .entity_mut(sun)
        .insert(Transform::default().looking_to(Vec3::NEG_Y, Vec3::NEG_Z));
    world.entity_mut(camera).insert(
        Transform::from_xyz(0.0, 2.0, 0.0).looking_to(Vec3::new(0.0, -0.35, -1.0), Vec3::Y),
    );
    let views = survey(&mut studio, 0);
    // The nearest ground in the picture is as deep as this.
    let near = 2.75;
    let config = ParallelSplitShadows {
        near,
        blend: 0.0,
        ..config(128, CascadeFit::Stable)
    };
    let setting = Setting::pssm("ramp", config);
    let outcome = studio.measure(&views, &setting, || ());
    keep("ramp", &views[0], &outcome);
    let world = studio.world();
    let plans = world.get::<ShadowPlans>(sun).expect("it is managed").views[&camera].clone();
    let lens = views[0].truth.lens;
    let mut measured_rows = [0; 2];
    let mut fewest = [f64::INFINITY; 2];
    for y in 0..SIZE.y {
        let row = (y * SIZE.x) as usize..((y + 1) * SIZE.x) as usize;
        let Some(sample) = views[0].truth.samples[row.start] else {
            continue;
        };
        let depth = lens.clip_from_world.row(3).dot(sample.point.extend(1.0));
        let Some(index) = plans.iter().position(|plan| depth < plan.blend_start) else {
            continue;
        };
        let shares: Vec<f64> = outcome.shots[0].shares[row]
            .iter()
            .map(|share| f64::from(share.unwrap_or(1.0)))
            .collect();
        // Pixels whose neighbors are within the ramp too.
        let slopes = shares
            .windows(4)
            .filter(|ramp| ramp.iter().all(|share| (0.02..0.98).contains(share)));
        for slope in slopes.map(|ramp| (ramp[1] - ramp[2]).abs()) {
            measured_rows[index] += 1;
            fewest[index] = fewest[index].min(slope);
        }
    }
    for (index, plan) in plans.iter().enumerate() {
        let predicted = plan.texels_per_pixel(f64::from(SIZE.y)).expect("a map");
        let found = fewest[index];
        assert!(measured_rows[index] > 20, "cascade {index}: too few ramps");
        approx::assert_relative_eq!(found, predicted, max_relative = 0.1);
    }
}
