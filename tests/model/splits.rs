//! Split planes against an independent 50-digit oracle, and their invariants.

use bevy_pssm::{SplitScheme, geometry::split::split_planes};
use proptest::prelude::*;

/// Columns: case, scheme, n, f, m, lambda, gamma, delta, i, depth.
const REFERENCE: &str = include_str!("../reference/splits.csv");

fn scheme_of(columns: &[&str]) -> SplitScheme {
    let number = |index: usize| columns[index].parse::<f64>().unwrap();
    match columns[1] {
        "uniform" => SplitScheme::Uniform,
        "logarithmic" => SplitScheme::Logarithmic,
        "practical" => SplitScheme::Practical { lambda: number(5) },
        "geometric" => SplitScheme::Geometric {
            gamma: number(6),
            bias: number(7),
        },
        "geometric_scaled" => SplitScheme::GeometricScaled {
            gamma: number(6),
            bias: number(7),
        },
        other => panic!("unknown scheme {other}"),
    }
}

#[test]
fn planes_equal_the_reference() {
    let mut rows = 0;
    for line in REFERENCE.lines().skip(1) {
        let columns: Vec<&str> = line.split(',').collect();
        let number = |index: usize| columns[index].parse::<f64>().unwrap();
        let (near, far, count) = (number(2), number(3), number(4) as usize);
        let planes = split_planes(&scheme_of(&columns), near, far, count);
        let (found, expected) = (planes[number(8) as usize], number(9));
        let error = ((found - expected) / expected).abs();
        assert!(error <= 1e-12, "{line}: found {found}, off by {error:e}");
        rows += 1;
    }
    assert_eq!(rows, 133);
}

fn any_scheme() -> impl Strategy<Value = SplitScheme> {
    prop_oneof![
        Just(SplitScheme::Uniform),
        Just(SplitScheme::Logarithmic),
        (0.0..=1.0).prop_map(|lambda| SplitScheme::Practical { lambda }),
        (1.001..50.0, 0.0..100.0).prop_map(|(gamma, bias)| SplitScheme::Geometric { gamma, bias }),
        (1.001..50.0, 0.0..100.0)
            .prop_map(|(gamma, bias)| SplitScheme::GeometricScaled { gamma, bias }),
    ]
}

proptest! {
    #[test]
    fn planes_run_from_near_to_far(
        scheme in any_scheme(),
        near in 1e-3..100.0,
        ratio in 1.001..1e6,
        count in 1_usize..=8,
    ) {
        let far = near * ratio;
        let planes = split_planes(&scheme, near, far, count);
        prop_assert_eq!(planes.len(), count + 1);
        prop_assert_eq!((planes[0], planes[count]), (near, far));
        for pair in planes.windows(2) {
            prop_assert!(pair[0] <= pair[1], "{:?}", planes);
        }
    }

    #[test]
    fn practical_planes_lie_between_logarithmic_and_uniform(
        lambda in 0.0..=1.0,
        near in 1e-3..100.0,
        ratio in 1.001..1e6,
        count in 1_usize..=8,
    ) {
        let far = near * ratio;
        let of = |scheme| split_planes(&scheme, near, far, count);
        let (log, uniform) = (of(SplitScheme::Logarithmic), of(SplitScheme::Uniform));
        let practical = of(SplitScheme::Practical { lambda });
        let slack = 1e-12 * far;
        for i in 0..=count {
            prop_assert!(log[i] <= practical[i] + slack && practical[i] <= uniform[i] + slack);
        }
    }
}

#[test]
fn logarithmic_slices_share_one_ratio_of_far_to_near() {
    let planes = split_planes(&SplitScheme::Logarithmic, 0.1, 1000.0, 4);
    for pair in planes.windows(2) {
        approx::assert_relative_eq!(pair[1] / pair[0], 10.0, max_relative = 1e-12);
    }
}
