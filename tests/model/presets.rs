//! Presets in RON: what is good loads, and every mistake gets its own message.

use bevy::{
    asset::AssetPath,
    reflect::{PartialReflect, ReflectRef},
};
use bevy_pssm::{config::ShadowPresetLoader, prelude::*};

const MAX_MAP_SIZE: u32 = 8192;

pub fn parse(text: &str) -> Result<ParallelSplitShadows, String> {
    ShadowPresetLoader::parse(
        text,
        &AssetPath::from("shadows/test.shadows.ron"),
        MAX_MAP_SIZE,
    )
    .map_err(|error| error.to_string())
}

#[test]
fn an_empty_preset_is_the_default() {
    assert_eq!(parse("()"), Ok(ParallelSplitShadows::default()));
}

#[test]
fn a_byte_order_mark_is_no_mistake() {
    assert_eq!(parse("\u{feff}(far: 77.0)"), parse("(far: 77.0)"));
    assert!(parse("(far: 77.0)").is_ok());
}

#[test]
fn every_field_and_variant_is_read() {
    let read = parse(
        "(
            cascades: 3, near: 0.5, far: 900.0,
            splits: Manual([20.0, 110.5]),
            blend: 0.2, fade: 0.0, fit: Tight, map_size: PerCascade([(1000, 1000), (777, 777), (64, 65)]),
            filter: Tent(Meters(0.3)), transition: Dither, slack: 0.25, grid: Ground, sun_step: 0.5, delay: 3,
            update_budget: Texels(5000000),
            comparison: (
                culling: Off, bias: SlopeScaled(factor: 2.0, meters: 0.01), caster_faces: Back,
                depth: Linear, focus: Off, warp_axis: BodyCenter, updates: EveryFrame,
            ),
        )",
    );
    let expected = ParallelSplitShadows {
        cascades: 3,
        near: 0.5,
        far: 900.0,
        splits: SplitScheme::Manual(vec![20.0, 110.5]),
        blend: 0.2,
        fade: 0.0,
        fit: CascadeFit::Tight,
        slack: 0.25,
        map_size: MapSize::PerCascade(vec![[1000; 2], [777; 2], [64, 65]]),
        filter: ShadowFilter::Tent(FilterRadius::Meters(0.3)),
        grid: TexelGrid::Ground,
        sun_step: 0.5,
        delay: 3,
        update_budget: UpdateBudget::Texels(5_000_000),
        transition: CascadeTransition::Dither,
        comparison: Comparison {
            bias: ShadowBias::SlopeScaled {
                factor: 2.0,
                meters: 0.01,
            },
            depth: DepthDistribution::Linear,
            caster_faces: CasterFaces::Back,
            warp_axis: WarpAxis::BodyCenter,
            culling: CasterCulling::Off,
            focus: ShadowFocus::Off,
            updates: MapUpdates::EveryFrame,
        },
    };
    assert_eq!(read, Ok(expected));
    for scheme in [
        "Uniform",
        "Logarithmic",
        "Practical(lambda: 0.3)",
        "Geometric(gamma: 2.5, bias: 0.0)",
        "GeometricScaled(gamma: 2.5, bias: 10.0)",
    ] {
        parse(&format!("(splits: {scheme})")).unwrap();
    }
    for fit in [
        "Stable",
        "Warped(Minimax)",
        "Warped(Lispsm)",
        "Warped(Lloyd(eta: -0.5))",
        "Warped(Trapezoid(focus: 0.3))",
        "Warped(Strength(0.5))",
        "PerCascade([Stable, Tight, Warped(Minimax), Warped(Strength(1.0))])",
    ] {
        parse(&format!("(fit: {fit})")).unwrap();
    }
    for bias in [
        "Automatic",
        "Constant(meters: 0.1)",
        "NormalOffset(texels: 1.5)",
        "ReceiverPlane(meters: 0.0)",
    ] {
        parse(&format!("(comparison: (bias: {bias}))")).unwrap();
    }
    for filter in [
        "Camera",
        "Hardware2x2",
        "Temporal(Texels(2.5))",
        "Soft(sun_degrees: 0.53)",
    ] {
        parse(&format!("(filter: {filter})")).unwrap();
    }
}

#[test]
fn what_is_written_is_read_back() {
    let config = ParallelSplitShadows {
        splits: SplitScheme::Geometric {
            gamma: 3.5,
            bias: 1.25,
        },
        map_size: MapSize::Halving(4096),
        ..Default::default()
    };
    let text = ron::to_string(&config).unwrap();
    assert_eq!(parse(&text), Ok(config));
}

#[test]
fn shipped_presets_are_good() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/assets/shadows");
    let mut count = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let text = std::fs::read_to_string(&path).unwrap();
        parse(&text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        count += 1;
    }
    assert!(count >= 4);
}

#[test]
fn the_balanced_preset_spells_the_defaults_out() {
    let text = include_str!("../../assets/shadows/balanced.shadows.ron");
    assert_eq!(parse(text), Ok(ParallelSplitShadows::default()));
    let config = ParallelSplitShadows::default();
    for part in [
        config.as_partial_reflect(),
        config.comparison.as_partial_reflect(),
    ] {
        let ReflectRef::Struct(part) = part.reflect_ref() else {
            unreachable!()
        };
        for index in 0..part.field_len() {
            let field = part.name_at(index).unwrap();
            assert!(text.contains(&format!(" {field}:")), "{field}");
        }
    }
}

/// Text, the line the message must name, and what else it must say.
const BAD: [(&str, usize, &[&str]); 43] = [
    ("", 1, &[]),
    ("(", 1, &["Unexpected end"]),
    ("(cascades: 4,\n far: ", 2, &["Expected float"]),
    ("(cascades: 4\n far: 9.0)", 2, &["Expected"]),
    ("(\n cascade: 4)", 2, &["cascade", "`cascades`"]),
    ("(cascades: 4)\n extra", 1, &["trailing"]),
    ("(\n\n cascades: 0)", 3, &["`cascades` is 0", "from 1 to 4"]),
    ("(cascades: 5)", 1, &["`cascades` is 5", "from 1 to 4"]),
    ("(cascades: -1)", 1, &["out of bounds"]),
    ("(cascades: 2.5)", 1, &["Expected"]),
    ("(cascades: \"four\")", 1, &["Expected"]),
    (
        "(// cascades, near\n near: 0.0)",
        2,
        &["`near` is 0", "from 0.000001"],
    ),
    (
        "(/* near\n near */\n near: -2.0)",
        3,
        &["`near` is -2", "from 0.000001"],
    ),
    ("(near: 1e-40)", 1, &["`near` is", "from 0.000001"]),
    ("(near: 600.0)", 1, &["`near` is 600", "below `far` (500)"]),
    ("(near: NaN)", 1, &["`near` is NaN", "from 0.000001"]),
    ("(far: inf)", 1, &["`far` is inf", "to 10000000"]),
    ("(far: -100.0)", 1, &["`far` is -100", "from 0.000001"]),
    (
        "(near: 50.0,\n far: 50.0)",
        2,
        &["`far` is 50", "above `near` (50)"],
    ),
    (
        "(splits: Practical(lambda: 1.5))",
        1,
        &["`lambda` is 1.5", "from 0 to 1"],
    ),
    ("(splits: Practical(lambda: NaN))", 1, &["`lambda` is NaN"]),
    ("(splits: Practical())", 1, &["lambda", "missing"]),
    (
        "(comparison: (bias: Constant(meters: -0.1)))",
        1,
        &["`meters` is -0.1", "from 0"],
    ),
    (
        "(comparison: (bias: SlopeScaled(factor: NaN, meters: 0.0)))",
        1,
        &["`factor` is NaN"],
    ),
    (
        "(filter: Tent(Texels(0.5)))",
        1,
        &["`Texels` is 0.5", "from 1 to 8"],
    ),
    (
        "(filter: Temporal(Meters(0.0)))",
        1,
        &["`Meters` is 0", "from 0.000001"],
    ),
    (
        "(filter: Soft(sun_degrees: 90.0))",
        1,
        &["`sun_degrees` is 90", "at most 20"],
    ),
    (
        "(splits: Geometric(gamma: 1.0, bias: 0.0))",
        1,
        &["`gamma` is 1", "above 1"],
    ),
    (
        "(splits: Geometric(gamma: 2.0,\n bias: -1.0))",
        2,
        &["`bias` is -1", "from 0 to 500"],
    ),
    ("(splits: Cubic)", 1, &["Cubic", "`Uniform`"]),
    (
        "(splits: Manual([10.0]))",
        1,
        &["`Manual` lists 1 values", "must list 3"],
    ),
    (
        "(splits:\n Manual([10.0, 9.0, 20.0]))",
        2,
        &["`Manual` plane 1 is 9", "above 10"],
    ),
    (
        "(splits: Manual([10.0, 20.0, 600.0]))",
        1,
        &["`Manual` plane 2 is 600", "below 500"],
    ),
    ("(blend: 0.75)", 1, &["`blend` is 0.75", "from 0 to 0.5"]),
    (
        "(fit: Warped(Lloyd(eta: 1.5)))",
        1,
        &["`eta` is 1.5", "from -1 to 1"],
    ),
    (
        "(fit: Warped(Trapezoid(focus: 0.0)))",
        1,
        &["`focus` is 0", "above 0"],
    ),
    (
        "(fit: Warped(Trapezoid(focus: 0.9)))",
        1,
        &["`focus` is 0.9", "to 0.8"],
    ),
    (
        "(fit: Warped(Strength(1.5)))",
        1,
        &["`Strength` is 1.5", "from 0 to 1"],
    ),
    (
        "(fit: PerCascade([Stable, Tight]))",
        1,
        &["`fit` lists 2 values", "must list 4"],
    ),
    ("(slack: 1.5)", 1, &["`slack` is 1.5", "from 0 to 1"]),
    (
        "(map_size: Same(0))",
        1,
        &["`map_size` is 0", "from 64 to 8192"],
    ),
    (
        "(map_size: PerCascade([(2048, 2048), (2048, 2048), (2048, 2048), (64, 8193)]))",
        1,
        &["`map_size` is 8193", "from 64 to 8192"],
    ),
    (
        "(map_size: PerCascade([(2048, 2048)]))",
        1,
        &["`map_size` lists 1 values", "must list 4"],
    ),
];

#[test]
fn every_mistake_has_its_own_message_with_file_and_line() {
    let mut messages = std::collections::HashSet::new();
    for (text, line, parts) in BAD {
        let message = parse(text).expect_err(text);
        let place = format!("shadows/test.shadows.ron:{line}:");
        assert!(
            message.starts_with(&place),
            "{text:?} gave {message:?}, expected {place}"
        );
        for part in parts {
            assert!(
                message.contains(part),
                "{text:?} gave {message:?} without {part:?}"
            );
        }
        assert!(
            messages.insert(message.clone()),
            "{text:?} shares the message {message:?}"
        );
    }
}

#[test]
fn limits_of_the_gpu_count() {
    let config = ParallelSplitShadows {
        map_size: MapSize::Halving(4096),
        ..Default::default()
    };
    assert!(config.validate(4096).is_ok());
    let message = config.validate(2048).unwrap_err().to_string();
    assert!(
        message.contains("4096") && message.contains("2048"),
        "{message}"
    );
    let shrinks_away = ParallelSplitShadows {
        map_size: MapSize::Halving(256),
        ..Default::default()
    };
    assert!(shrinks_away.validate(4096).is_err());
}
