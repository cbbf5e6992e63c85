//! What a camera and a light cost the CPU each frame: planning, and testing casters.

use core::hint::black_box;

use bevy::{
    camera::{CameraProjection, PerspectiveProjection},
    light::DirectionalLight,
    math::{DAffine3, DMat3, DVec3},
};
use bevy_pssm::{
    CascadeFit, MapWarp, ParallelSplitShadows,
    geometry::{light_frame::LightFrame, receivers::Receivers, slice::ViewVolume},
    plan::{PlanHistory, PlanInputs, plan_cascades},
};
use criterion::{Criterion, criterion_group, criterion_main};

const CASTERS: usize = 10_000;

fn planning(criterion: &mut Criterion) {
    let projection = PerspectiveProjection::default();
    let view = ViewVolume::new(
        DAffine3::from_translation(DVec3::new(500.0, 20.0, -300.0)),
        &projection.get_clip_from_view(),
    )
    .expect("a sound camera");
    let light = LightFrame::new(DVec3::new(0.3, 0.7, 0.4)).expect("a direction");
    let reach = ParallelSplitShadows::default().lookup_reach(&DirectionalLight::default());
    let mut receivers = Receivers::new(&view);
    receivers.add(
        DVec3::new(500.0, 0.0, -800.0),
        &DMat3::from_diagonal(DVec3::new(800.0, 12.0, 800.0)),
    );
    let plan = |config: &ParallelSplitShadows, history: &mut PlanHistory| {
        let inputs = PlanInputs {
            view: black_box(&view),
            light: &light,
            config,
            reach,
            receivers: &receivers,
            image_height: 1080.0,
        };
        plan_cascades(&inputs, history)
    };
    for (name, fit) in [
        ("stable", CascadeFit::Stable),
        ("tight", CascadeFit::Tight),
        ("warped", CascadeFit::Warped(MapWarp::Minimax)),
    ] {
        let config = ParallelSplitShadows {
            fit,
            ..Default::default()
        };
        let mut history = PlanHistory::default();
        criterion.bench_function(&format!("plan 4 cascades, {name}"), |bencher| {
            bencher.iter(|| plan(&config, &mut history));
        });
    }

    let plan = plan(
        &ParallelSplitShadows::default(),
        &mut PlanHistory::default(),
    );
    let boxes: Vec<(DVec3, DMat3)> = (0..CASTERS)
        .map(|i| {
            let (row, column) = (i / 100, i % 100);
            let place = DVec3::new(10.0 * column as f64, 2.0, -10.0 * row as f64);
            (place, DMat3::from_diagonal(DVec3::new(1.0, 2.0, 1.5)))
        })
        .collect();
    criterion.bench_function(
        &format!("test {CASTERS} casters against 4 hulls"),
        |bencher| {
            bencher.iter(|| {
                plan.iter()
                    .filter_map(|cascade| cascade.map.as_ref())
                    .map(|map| {
                        let meets = |(centre, axes): &&(DVec3, DMat3)| {
                            map.hull.intersects_box(*centre, axes)
                        };
                        black_box(&boxes).iter().filter(meets).count()
                    })
                    .sum::<usize>()
            });
        },
    );
}

criterion_group!(benches, planning);
criterion_main!(benches);
