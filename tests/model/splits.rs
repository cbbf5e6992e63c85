//! Split planes against an independent 50-digit oracle, and their invariants.

use bevy_pssm::{SplitScheme, geometry::split, plan::split_planes};
use proptest::prelude::*;

/// Columns: case, scheme, n, f, m, lambda, gamma, delta, i, depth.
const REFERENCE: &str = include_str!("../reference/splits.csv");

/// The plane that a row is about, by the plain formulas.
fn plane_of(columns: &[&str]) -> f64 {
    let number = |index: usize| columns[index].parse::<f64>().unwrap();
    let (near, far, count, index) = (number(2), number(3), number(4) as usize, number(8) as usize);
    if index == 0 || index == count {
        return if index == 0 { near } else { far };
    }
    match columns[1] {
        "uniform" => split::uniform(near, far, index, count),
        "logarithmic" => split::logarithmic(near, far, index, count),
        "practical" => split::practical(number(5), near, far, index, count),
        "geometric" => split::geometric(number(6), number(7), near, far, index, count),
        "geometric_scaled" => {
            split::geometric_scaled(number(6), number(7), near, far, index, count)
        }
        other => panic!("unknown scheme {other}"),
    }
}

#[test]
fn planes_equal_the_reference() {
    let mut rows = 0;
    for line in REFERENCE.lines().skip(1) {
        let columns: Vec<&str> = line.split(',').collect();
        let number = |index: usize| columns[index].parse::<f64>().unwrap();
        let (found, expected) = (plane_of(&columns), number(9));
        let error = ((found - expected) / expected).abs();
        assert!(error <= 1e-12, "{line}: found {found}, off by {error:e}");
        rows += 1;
    }
    assert_eq!(rows, 133);
}

pub fn any_scheme() -> impl Strategy<Value = SplitScheme> {
    prop_oneof![
        Just(SplitScheme::Uniform),
        Just(SplitScheme::Logarithmic),
        (0.0..=1.0_f32).prop_map(|lambda| SplitScheme::Practical { lambda }),
        (1.001..50.0_f32, 0.0..100.0_f32)
            .prop_map(|(gamma, bias)| SplitScheme::Geometric { gamma, bias }),
        (1.001..50.0_f32, 0.0..100.0_f32)
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
        lambda in 0.0..=1.0_f32,
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

#[test]
fn manual_planes_are_those_that_are_set() {
    let scheme = SplitScheme::Manual(vec![4.0, 9.0, 25.0]);
    let planes = split_planes(&scheme, 1.0, 100.0, 4);
    assert_eq!(planes, [1.0, 4.0, 9.0, 25.0, 100.0]);
}
