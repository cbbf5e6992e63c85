//! The program `predict`.

#[path = "../../examples/predict/arguments.rs"]
mod arguments;
#[path = "../../examples/predict/cascades.rs"]
mod cascades;
#[path = "../../examples/predict/figures.rs"]
mod figures;
#[path = "../../examples/predict/hemisphere.rs"]
mod hemisphere;
#[path = "../../examples/predict/plot.rs"]
mod plot;
#[path = "../../examples/predict/report.rs"]
mod report;

use bevy::light::DirectionalLight;
use bevy_pssm::{
    MapSize, ParallelSplitShadows,
    geometry::{aliasing::closed_form, light_frame::LightFrame, receivers::Receivers},
    plan::{CasterChanges, PlanHistory, PlanInputs, lookup_reach, plan_cascades},
};
use clap::Parser;
use proptest::prelude::*;

use arguments::Arguments;
use cascades::Cascade;
use figures::{Figure, Light, Point, RATIO, Scheme, THETA};

fn parse(arguments: &[&str]) -> Result<Arguments, String> {
    Arguments::try_parse_from([&["predict"], arguments].concat()).map_err(|e| e.to_string())
}

fn predict(arguments: &[&str]) -> Vec<Cascade> {
    parse(arguments).unwrap().setup().unwrap().cascades()
}

fn storage(arguments: &[&str]) -> f64 {
    let cascades = predict(arguments);
    cascades.iter().map(|c| c.storage_factor.unwrap()).sum()
}

#[test]
fn logarithmic_cascades_are_alike() {
    for light in ["0,-1,0", "0,0,-1", "0.3,-1,-0.5"] {
        for more in [
            ["--fit", "body", "--warp", "none"],
            ["--fit", "body", "--warp", "lispsm"],
            ["--fit", "body", "--warp", "minimax"],
            ["--fit", "stable", "--warp", "none"],
        ] {
            let arguments = [&["--splits", "logarithmic", "--light", light], &more[..]];
            let cascades = predict(&arguments.concat());
            let first = cascades[0].storage_factor.unwrap();
            for cascade in cascades {
                let storage = cascade.storage_factor.unwrap();
                approx::assert_relative_eq!(storage, first, max_relative = 1e-9);
            }
        }
    }
}

/// What `--fit stable` predicts is what the plugin plans, blend bands apart. (Its first map
/// reaches to the eye, and is a little larger for it.)
#[test]
fn stable_predictions_equal_the_plans() {
    let arguments = parse(&["--fit", "stable", "--far", "300", "--size", "1024"]).unwrap();
    let setup = arguments.setup().unwrap();
    let config = ParallelSplitShadows {
        far: 300.0,
        blend: 0.0,
        slack: 0.0,
        map_size: MapSize::Same(1024),
        ..Default::default()
    };
    let reach = lookup_reach(&config, &DirectionalLight::default());
    let light = LightFrame::new(setup.to_light).unwrap();
    let inputs = PlanInputs {
        view: &setup.view,
        light: &light,
        config: &config,
        reach,
        receivers: &Receivers::everywhere(&setup.view),
        image_height: 1080.0,
        changes: &CasterChanges::Anywhere,
    };
    let plans = plan_cascades(&inputs, &mut PlanHistory::default());
    for (index, (plan, predicted)) in plans.iter().zip(setup.cascades()).enumerate() {
        let planned = plan.texels_per_pixel(setup.image_height).unwrap();
        let axes = [predicted.texels_per_pixel_x, predicted.texels_per_pixel_y];
        let predicted = axes.map(Option::unwrap).into_iter().fold(1e9, f64::min);
        let tolerance = if index == 0 { 0.05 } else { 1e-9 };
        approx::assert_relative_eq!(planned, predicted, max_relative = tolerance);
    }
}

/// Self-similar slices: a map beyond a plane is as much larger as its slice.
#[test]
fn seams_of_uniform_maps_are_the_ratio_of_slices() {
    for fit in ["body", "stable"] {
        let cascades = predict(&[
            "--near",
            "1",
            "--far",
            "10000",
            "--splits",
            "logarithmic",
            "--fit",
            fit,
        ]);
        assert_eq!((cascades[0].seam_x, cascades[0].seam_y), (None, None));
        for cascade in &cascades[1..] {
            for seam in [cascade.seam_x, cascade.seam_y] {
                approx::assert_relative_eq!(seam.unwrap(), 10.0, max_relative = 1e-9);
            }
        }
    }
}

/// Lloyd et al. 2006, "Seams": a warp that makes errors equal at both ends leaves none along it.
#[test]
fn warped_overhead_maps_have_no_seam_along_the_warp() {
    for warp in ["lispsm", "minimax"] {
        let cascades = predict(&[
            "--near",
            "1",
            "--far",
            "10000",
            "--splits",
            "logarithmic",
            "--light",
            "0,-1,0",
            "--warp",
            warp,
        ]);
        for cascade in &cascades[1..] {
            approx::assert_relative_eq!(cascade.seam_y.unwrap(), 1.0, max_relative = 1e-9);
            let seam_x = cascade.seam_x.unwrap();
            approx::assert_relative_eq!(seam_x, 10_f64.sqrt(), max_relative = 1e-9);
        }
    }
}

#[test]
fn pixels_and_storage_follow_from_each_other() {
    for cascade in predict(&["--size", "1000", "--height", "500", "--aspect", "2"]) {
        let (x, y) = (
            cascade.pixels_per_texel_x.unwrap(),
            cascade.pixels_per_texel_y.unwrap(),
        );
        // Texels of a map in which none shows, over pixels of the image.
        let storage = (1000.0 * x) * (1000.0 * y) / (1000.0 * 500.0);
        let found = cascade.storage_factor.unwrap();
        approx::assert_relative_eq!(found, storage, max_relative = 1e-12);
        assert_eq!(cascade.texels_per_pixel_x, Some(x.recip()));
        assert_eq!(cascade.texels_per_pixel_y, Some(y.recip()));
    }
}

#[test]
fn square_images_have_the_storage_of_the_closed_forms() {
    let paper = [
        "--near",
        "2",
        "--far",
        "2000",
        "--aspect",
        "1",
        "--splits",
        "logarithmic",
        "--light",
    ];
    let tan = 30_f64.to_radians().tan();
    for (more, expected) in [
        (vec!["0,-1,0"], closed_form::overhead(1e3, tan, 4)),
        (
            vec!["0,-1,0", "--warp", "minimax"],
            closed_form::overhead_warped(1e3, tan, 4),
        ),
        (vec!["0,0,-1"], closed_form::behind(1e3, 4)),
    ] {
        let found = storage(&[&paper, &more[..]].concat());
        approx::assert_relative_eq!(found, expected, max_relative = 1e-9);
    }
}

#[test]
fn coinciding_planes_leave_cascades_without_figures() {
    let arguments = ["--splits", "Geometric(gamma: 2, bias: 499)"];
    let cascades = predict(&arguments);
    assert!(cascades[0].storage_factor.is_some());
    for empty in &cascades[1..] {
        assert_eq!((empty.near, empty.far), (500.0, 500.0));
        assert_eq!((empty.storage_factor, empty.seam_x), (None, None));
    }
    let setup = parse(&arguments).unwrap().setup().unwrap();
    let csv = report::csv(&setup).unwrap();
    assert!(csv.ends_with("4,500.0,500.0,,,,,,,\n"), "{csv}");
    assert!(report::table(&setup).contains("4    500.0    500.0        -"));
}

#[test]
fn reports_have_a_line_for_each_cascade() {
    let setup = parse(&["--cascades", "6"]).unwrap().setup().unwrap();
    let csv = report::csv(&setup).unwrap();
    assert_eq!(csv.lines().count(), 1 + 6);
    assert!(csv.starts_with("cascade,near,far,pixels_per_texel_x,"));
    let table = report::table(&setup);
    let width = |line: &str| line.starts_with("     ").then_some(line.len());
    let rows: Vec<usize> = table.lines().skip(5).map_while(width).collect();
    assert_eq!(rows, [rows[0]; 6], "{table}");
}

#[test]
fn bad_arguments_are_named_with_what_is_allowed() {
    for (arguments, name, allowed) in [
        (&["--near", "0"][..], "--near", "from 0.001 to 10000000"),
        (&["--far", "nan"], "--far", "from 0.001 to 10000000"),
        (&["--near", "9", "--far", "8"], "--far", "above --near (9)"),
        (&["--fov", "180"], "--fov", "from 1 to 170"),
        (&["--aspect", "-1"], "--aspect", "from 0.1 to 10"),
        (&["--cascades", "0"], "--cascades", "1..=64"),
        (&["--size", "many"], "--size", "invalid digit"),
        (&["--height", "0"], "--height", "1..=65536"),
        (&["--light", "0,0,0"], "--light", "not all zero"),
        (&["--light", "1,2"], "--light", "X,Y,Z"),
        (&["--light", "inf,0,0"], "--light", "X,Y,Z"),
        (&["--splits", "cubic"], "--splits", "Practical(lambda: L)"),
        (
            &["--splits", "Practical(lambda: 2)"],
            "--splits",
            "from 0 to 1",
        ),
        (
            &["--splits", "Manual([10])"],
            "--splits",
            "one fewer than --cascades (4)",
        ),
        (
            &["--splits", "Manual([10])", "--cascades", "65"],
            "--cascades",
            "1..=64",
        ),
        (
            &["--splits", "Manual([10, 9])", "--cascades", "3"],
            "--splits",
            "must grow",
        ),
        (
            &["--splits", "Manual([NaN])", "--cascades", "2"],
            "--splits",
            "must grow",
        ),
        (&["--fit", "stable", "--warp", "lispsm"], "--warp", "none"),
        (&["--figure", "lloyd11"], "--figure", "lloyd12"),
        (&["--out", "x"], "--figure", "required"),
    ] {
        let setup = parse(arguments).and_then(|arguments| arguments.setup());
        let message = setup
            .err()
            .unwrap_or_else(|| panic!("{arguments:?} is accepted"));
        assert!(message.contains(name), "{arguments:?}: {message}");
        assert!(message.contains(allowed), "{arguments:?}: {message}");
    }
}

fn in_range(exponents: core::ops::Range<f64>) -> impl Strategy<Value = String> {
    exponents.prop_map(|exponent| 10_f64.powf(exponent).to_string())
}

proptest! {
    #[test]
    fn whatever_is_accepted_has_finite_figures(
        near in in_range(-3.0..3.0),
        ratio in 0.001..4.0_f64,
        fov in 1.0..170.0_f64,
        aspect in in_range(-1.0..1.0),
        cascades in 1..=64_u32,
        splits in prop::sample::select(vec![
            "uniform", "logarithmic", "practical", "Geometric(gamma: 3, bias: 0)",
            "GeometricScaled(gamma: 1.1, bias: 0)",
        ]),
        (fit, warp) in prop::sample::select(vec![
            ("body", "none"), ("body", "lispsm"), ("body", "minimax"), ("stable", "none"),
        ]),
        light in [-1.0..1.0, -1.0..1.0, -1.0..1.0_f64],
    ) {
        let far = (near.parse::<f64>().unwrap() * 10_f64.powf(ratio)).to_string();
        let [x, y, z] = light;
        let rows = predict(&[
            "--near", &near, "--far", &far, "--fov", &fov.to_string(), "--aspect", &aspect,
            "--cascades", &cascades.to_string(), "--splits", splits, "--fit", fit,
            "--warp", warp, "--light", &format!("{x},{y},{z}"),
        ]);
        prop_assert_eq!(rows.len(), cascades as usize);
        for row in rows {
            for figure in [
                row.pixels_per_texel_x, row.pixels_per_texel_y, row.texels_per_pixel_x,
                row.texels_per_pixel_y, row.storage_factor,
            ] {
                // Planes this close may coincide.
                prop_assert!(figure.map_or(row.far <= row.near, |f| f.is_finite() && f > 0.0));
            }
            for seam in [row.seam_x, row.seam_y].into_iter().flatten() {
                prop_assert!(seam.is_finite() && seam > 0.0);
            }
        }
    }
}

#[test]
fn curves_equal_the_closed_forms() {
    let tan = THETA.to_radians().tan();
    for figure in [Figure::Lloyd10, Figure::Lloyd12] {
        for point in figure.points().unwrap() {
            let Point { light, scheme, .. } = point;
            let k = point.partitions.unwrap_or(1);
            let (expected, maps) = match (light, scheme) {
                (_, Scheme::Optimum) => (5.98229, None),
                (Light::Overhead, Scheme::Depth) => (closed_form::overhead(RATIO, tan, k), Some(k)),
                (Light::Overhead, Scheme::DepthWarped | Scheme::DepthLispsm) => {
                    (closed_form::overhead_warped(RATIO, tan, k), Some(k))
                }
                (Light::Overhead, Scheme::FacesDepthWarped) => {
                    (closed_form::overhead_warped(RATIO, tan, k), Some(4 * k))
                }
                (Light::Behind, Scheme::FacesDepthWarped) => {
                    (closed_form::behind_faces(RATIO, k), Some(4 * k + 1))
                }
                (Light::Behind, _) => (closed_form::behind(RATIO, k), Some(k)),
            };
            let tolerance = if scheme == Scheme::Optimum {
                1e-6
            } else {
                1e-9
            };
            let found = point.storage_factor;
            approx::assert_relative_eq!(found, expected, max_relative = tolerance);
            assert_eq!(point.maps, maps);
        }
    }
}

/// Values worked out by hand for the paper's parameters.
#[test]
fn curves_pass_through_known_values() {
    let points = Figure::Lloyd12.points().unwrap();
    for (k, expected) in [
        (1, [865_159.378, 865.15938, 1e6, 1999.0]),
        (4, [90.064437, 16.015973, 126.491106, 37.987306]),
        (8, [22.530791, 9.501156, 44.987306, 22.941979]),
    ] {
        let curves = [
            (Light::Overhead, Scheme::Depth),
            (Light::Overhead, Scheme::DepthWarped),
            (Light::Behind, Scheme::Depth),
            (Light::Behind, Scheme::FacesDepthWarped),
        ];
        for ((light, scheme), expected) in curves.into_iter().zip(expected) {
            let is = |p: &&Point| (p.light, p.scheme, p.partitions) == (light, scheme, Some(k));
            let found = points.iter().find(is).unwrap().storage_factor;
            approx::assert_relative_eq!(found, expected, max_relative = 1e-6);
        }
    }
}

/// As Lloyd et al. 2006 say of their figure 7: without a warp high everywhere; with one lowest from
/// above and as high as without from behind and in front; with faces low there, too.
#[test]
fn the_hemisphere_is_as_the_paper_says() {
    let spots = hemisphere::spots().unwrap();
    let at = |scheme, across: f64, up: f64| {
        let is = |spot: &&hemisphere::Spot| {
            spot.scheme == scheme && (spot.across - across).hypot(spot.up - up) < 1e-9
        };
        spots.iter().find(is).unwrap().storage_factor
    };
    let of = |scheme| spots.iter().filter(move |spot| spot.scheme == scheme);
    let [above, behind, before] = [(0.0, 0.0), (-1.0, 0.0), (1.0, 0.0)];
    for (scheme, expected) in [
        (Scheme::Depth, [865_159.378, 1e6, 1e6]),
        (Scheme::DepthLispsm, [865.15938, 1e6, 1e6]),
        (Scheme::DepthWarped, [865.15938, 1e6, 1e6]),
        (Scheme::FacesDepthWarped, [865.15938, 1999.0, 1999.0]),
    ] {
        for ((across, up), expected) in [above, behind, before].into_iter().zip(expected) {
            let found = at(scheme, across, up);
            approx::assert_relative_eq!(found, expected, max_relative = 1e-6);
        }
        let least = of(scheme)
            .map(|spot| spot.storage_factor)
            .fold(f64::INFINITY, f64::min);
        if scheme != Scheme::Depth {
            assert!(least > 0.7 * 865.0, "{scheme:?}: {least}");
        }
    }
    let worst = |scheme| {
        of(scheme)
            .map(|spot| spot.storage_factor)
            .fold(0.0, f64::max)
    };
    // A box along the diagonal of a square picture.
    assert!((1.9e6..2.01e6).contains(&worst(Scheme::Depth)));
    // What the paper's warp loses almost behind, the least worst error's does not.
    assert!(worst(Scheme::DepthLispsm) > 1.5 * worst(Scheme::Depth));
    assert!(worst(Scheme::DepthWarped) <= 1.02 * worst(Scheme::Depth));
    assert!(worst(Scheme::FacesDepthWarped) < 1.6 * 1999.0);
    for (warped, plain) in of(Scheme::DepthWarped).zip(of(Scheme::Depth)) {
        assert!(
            warped.storage_factor <= 1.02 * plain.storage_factor,
            "{warped:?}"
        );
    }
}

#[test]
fn figures_are_written_as_csv_and_svg() {
    let folder = std::env::temp_dir().join(format!("predict-{}", std::process::id()));
    for (figure, points) in [
        (Figure::Lloyd10, 2 * 16 + 1),
        (Figure::Lloyd12, 4 * 33 + 2 * 8),
    ] {
        let [csv, svg] = figures::write(figure, &folder)
            .unwrap()
            .map(|file| std::fs::read_to_string(file).unwrap());
        assert!(csv.starts_with("light,scheme,partitions,maps,storage_factor\noverhead,ZP,1,1,"));
        assert_eq!(csv.lines().count(), 1 + points);
        assert!(
            svg.starts_with("<svg") && svg.contains("ZP+W, overhead"),
            "{svg}"
        );
    }
    let [csv, svg] = figures::write(Figure::Lloyd7, &folder)
        .unwrap()
        .map(|file| std::fs::read_to_string(file).unwrap());
    assert!(csv.starts_with("scheme,across,up,storage_factor\nZP,"));
    assert!(csv.lines().count() > 4 * 2800);
    assert!(svg.starts_with("<svg") && svg.contains("faces, warped"));
    std::fs::remove_dir_all(&folder).unwrap();

    let file = std::env::temp_dir().join(format!("predict-{}.txt", std::process::id()));
    std::fs::write(&file, "").unwrap();
    let error = figures::write(Figure::Lloyd10, &file)
        .unwrap_err()
        .to_string();
    assert!(error.starts_with(&file.display().to_string()), "{error}");
    std::fs::remove_file(&file).unwrap();
}
