//! Settings that nobody would write: texts of presets at random, and components while the app runs.

use core::{cell::RefCell, fmt::Debug, ops::Range};

use bevy::{app::App, ecs::entity::Entity, light::Cascades};
use bevy_pssm::{ManagedLight, ShadowPlans, plan::CascadePlan, prelude::*};
use proptest::{prelude::*, sample::Index, test_runner::TestRunner};

use crate::{
    lights::{app, camera, sun},
    presets::parse,
    stress::case::{Case, MAX_MAP_SIZE, Outcome},
};

/// Good ones, to begin with.
const TEXTS: [&str; 5] = [
    include_str!("../../assets/shadows/balanced.shadows.ron"),
    include_str!("../../assets/shadows/vista.shadows.ron"),
    "(
        cascades: 3, near: 0.5, far: 900.0,
        splits: Manual([20.0, 110.5]),
        fit: PerCascade([Stable, Tight, Warped(Strength(0.5))]),
        map_size: PerCascade([(1000, 1000), (777, 777), (64, 65)]),
        filter: Tent(Meters(0.3)), transition: Dither, slack: 0.25, grid: Ground, sun_step: 0.5, delay: 3,
        comparison: (
            culling: Off, bias: SlopeScaled(factor: 2.0, meters: 0.01), caster_faces: Back,
            depth: Linear, focus: Off, warp_axis: BodyCenter, updates: EveryFrame,
        ),
    )",
    "(
        splits: Geometric(gamma: 2.5, bias: 10.0), fit: Faces, map_size: Budget(4194304),
        filter: Soft(sun_degrees: 0.53), comparison: (bias: NormalOffset(texels: 1.5)),
    )",
    "(
        splits: GeometricScaled(gamma: 1.5, bias: 1.0), fit: Warped(Lloyd(eta: -0.5)),
        map_size: Halving(1024), filter: Temporal(Texels(2.5)),
        comparison: (bias: ReceiverPlane(meters: 0.0)),
    )",
];

/// Characters, or words and the characters between them.
fn pieces(text: &str, by_word: bool) -> Vec<String> {
    let is_in_word = |c: char| c.is_alphanumeric() || "_.+-".contains(c);
    let chars: Vec<char> = text.chars().collect();
    let pieces = chars.chunk_by(|a, b| by_word && is_in_word(*a) && is_in_word(*b));
    pieces.map(|piece| piece.iter().collect()).collect()
}

/// Pieces of a text of a kind.
#[derive(Debug, Clone, Copy)]
enum Kind {
    Any,
    Word,
    Number,
}

impl Kind {
    fn is(self, piece: &str) -> bool {
        match self {
            Self::Any => true,
            Self::Word => piece.starts_with(char::is_alphabetic),
            Self::Number => piece.parse::<f32>().is_ok(),
        }
    }
}

#[derive(Debug, Clone)]
enum Change {
    Delete,
    Repeat,
    Replace(String),
    /// With another of the same kind.
    Swap(Index),
    Nest {
        brackets: [&'static str; 2],
        depth: usize,
    },
}

/// A change to one of the pieces of a kind.
#[derive(Debug, Clone)]
struct Mutation {
    kind: Kind,
    at: Index,
    change: Change,
}

impl Mutation {
    fn apply(&self, pieces: &mut Vec<String>) {
        let places: Vec<usize> = (0..pieces.len())
            .filter(|place| self.kind.is(&pieces[*place]))
            .collect();
        if places.is_empty() {
            return;
        }
        let at = *self.at.get(&places);
        match &self.change {
            Change::Delete => {
                pieces.remove(at);
            }
            Change::Repeat => {
                let piece = pieces[at].clone();
                pieces.insert(at, piece);
            }
            Change::Replace(piece) => pieces[at].clone_from(piece),
            Change::Swap(other) => pieces.swap(at, *other.get(&places)),
            Change::Nest {
                brackets: [opening, closing],
                depth,
            } => {
                let [opening, closing] = [opening.repeat(*depth), closing.repeat(*depth)];
                pieces[at] = [opening.as_str(), &pieces[at], &closing].concat();
            }
        }
    }
}

fn written_number() -> impl Strategy<Value = String> {
    let odd = [
        "inf",
        "-inf",
        "NaN",
        "0",
        "-0.0",
        "1e-46",
        "1e39",
        "1e999",
        "-1",
        "0x10",
        "1_000",
        "4294967296",
        "340282366920938463463374607431768211456",
    ];
    prop_oneof![
        prop::sample::select(odd.to_vec()).prop_map(str::to_owned),
        any::<u32>().prop_map(|bits| format!("{:?}", f32::from_bits(bits))),
        any::<u64>().prop_map(|number| number.to_string()),
        (0.0..10.0_f32).prop_map(|number| format!("{number:?}")),
        (0..5000_u32).prop_map(|number| number.to_string()),
    ]
}

fn written_piece() -> impl Strategy<Value = String> {
    let syntax = [
        "(",
        ")",
        "[",
        "]",
        "{",
        "}",
        ",",
        ":",
        "\"",
        "'",
        "()",
        "Some(",
        "/*",
        "*/",
        "//",
        "\n",
        "r#\"",
        "#![enable(implicit_some)]",
        "#![enable(unwrap_newtypes)]",
        "\u{feff}",
        "\0",
        "Stable",
        "Faces",
        "Uniform",
        "Warped(Minimax)",
        "Auto(sharpness: 1.0)",
        "cascades",
        "far",
    ];
    prop_oneof![
        written_number(),
        prop::sample::select(syntax.to_vec()).prop_map(str::to_owned),
        any::<char>().prop_map(String::from),
    ]
}

fn mutation() -> impl Strategy<Value = Mutation> {
    let brackets = [
        ["(", ")"],
        ["[", "]"],
        ["{", "}"],
        ["Some(", ")"],
        ["/*", "*/"],
    ];
    let nest = (
        prop::sample::select(brackets.to_vec()),
        prop_oneof![1..4_usize, Just(10_000_usize)],
    );
    let change = prop_oneof![
        Just(Change::Delete),
        Just(Change::Repeat),
        written_piece().prop_map(Change::Replace),
        any::<Index>().prop_map(Change::Swap),
        nest.prop_map(|(brackets, depth)| Change::Nest { brackets, depth }),
    ];
    let kind = prop::sample::select(vec![Kind::Any, Kind::Word]);
    prop_oneof![
        (kind, any::<Index>(), change).prop_map(|(kind, at, change)| Mutation { kind, at, change }),
        // Most others are not read at all.
        (any::<Index>(), written_number()).prop_map(|(at, number)| Mutation {
            kind: Kind::Number,
            at,
            change: Change::Replace(number),
        }),
    ]
}

fn are_finite<'a>(plans: impl IntoIterator<Item = &'a CascadePlan>) -> Outcome {
    let maps = plans.into_iter().filter_map(|plan| plan.map.as_ref());
    for map in maps {
        for matrix in [
            map.clip_from_world,
            map.clip_from_cascade,
            map.world_from_cascade,
        ] {
            let is_finite = matrix.is_finite() && matrix.as_mat4().is_finite();
            prop_assert!(is_finite, "{matrix}");
        }
    }
    Ok(())
}

#[test]
fn what_is_mutated_is_good() {
    for text in TEXTS {
        assert!(parse(text).is_ok(), "{:?}", parse(text));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]

    #[test]
    fn presets_that_are_read_can_be_planned(
        text in prop::sample::select(TEXTS.to_vec()),
        by_word in any::<bool>(),
        mutations in prop::collection::vec(mutation(), 1..4),
    ) {
        let mut text = pieces(text, by_word);
        for mutation in &mutations {
            mutation.apply(&mut text);
        }
        if let Ok(config) = parse(&text.concat()) {
            Case::with_config(config).run(|planned| are_finite(&planned.plans))?;
        }
    }
}

/// Mostly of a usual size, or else of any bits.
fn number(usual: Range<f32>) -> impl Strategy<Value = f32> {
    let odd = vec![
        0.0,
        -0.0,
        -1.0,
        f32::NAN,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::MIN_POSITIVE,
        f32::MAX,
    ];
    prop_oneof![
        20 => usual,
        1 => prop::sample::select(odd),
        1 => any::<u32>().prop_map(f32::from_bits),
    ]
}

fn count(usual: Range<u32>) -> impl Strategy<Value = u32> {
    prop_oneof![20 => usual, 1 => any::<u32>()]
}

fn splits() -> impl Strategy<Value = SplitScheme> {
    let growth = || (number(1.1..4.0), number(0.0..10.0));
    prop_oneof![
        Just(SplitScheme::Uniform),
        Just(SplitScheme::Logarithmic),
        number(0.0..1.0).prop_map(|lambda| SplitScheme::Practical { lambda }),
        growth().prop_map(|(gamma, bias)| SplitScheme::Geometric { gamma, bias }),
        growth().prop_map(|(gamma, bias)| SplitScheme::GeometricScaled { gamma, bias }),
        prop::collection::vec(number(1.0..100.0), 0..5).prop_map(SplitScheme::Manual),
    ]
}

fn warp() -> impl Strategy<Value = MapWarp> {
    prop_oneof![
        Just(MapWarp::Minimax),
        Just(MapWarp::Lispsm),
        number(-1.0..1.0).prop_map(|eta| MapWarp::Lloyd { eta }),
        number(0.01..0.8).prop_map(|focus| MapWarp::Trapezoid { focus }),
        number(0.0..1.0).prop_map(MapWarp::Strength),
    ]
}

fn fit() -> impl Strategy<Value = CascadeFit> {
    let map_fit = prop_oneof![
        Just(MapFit::Stable),
        Just(MapFit::Steady),
        Just(MapFit::Tight),
        warp().prop_map(MapFit::Warped),
    ];
    prop_oneof![
        Just(CascadeFit::Stable),
        Just(CascadeFit::Steady),
        Just(CascadeFit::Tight),
        Just(CascadeFit::Faces),
        warp().prop_map(CascadeFit::Warped),
        number(0.0..1.0).prop_map(|sharpness| CascadeFit::Auto { sharpness }),
        prop::collection::vec(map_fit, 0..6).prop_map(CascadeFit::PerCascade),
    ]
}

fn map_size() -> impl Strategy<Value = MapSize> {
    let side = || count(64..4096);
    prop_oneof![
        3 => side().prop_map(MapSize::Same),
        2 => side().prop_map(MapSize::Halving),
        2 => count(100_000..10_000_000).prop_map(MapSize::Budget),
        1 => prop::collection::vec(prop::array::uniform2(side()), 0..6)
            .prop_map(MapSize::PerCascade),
    ]
}

fn filter() -> impl Strategy<Value = ShadowFilter> {
    let radius = || {
        prop_oneof![
            number(1.0..8.0).prop_map(FilterRadius::Texels),
            number(0.01..1.0).prop_map(FilterRadius::Meters),
        ]
    };
    prop_oneof![
        Just(ShadowFilter::Camera),
        Just(ShadowFilter::Hardware2x2),
        radius().prop_map(ShadowFilter::Tent),
        radius().prop_map(ShadowFilter::Temporal),
        number(0.1..20.0).prop_map(|sun_degrees| ShadowFilter::Soft { sun_degrees }),
    ]
}

fn bias() -> impl Strategy<Value = ShadowBias> {
    prop_oneof![
        Just(ShadowBias::Automatic),
        number(0.0..1.0).prop_map(|meters| ShadowBias::Constant { meters }),
        (number(0.0..4.0), number(0.0..1.0))
            .prop_map(|(factor, meters)| ShadowBias::SlopeScaled { factor, meters }),
        number(0.0..1000.0).prop_map(|texels| ShadowBias::NormalOffset { texels }),
        number(0.0..1.0).prop_map(|meters| ShadowBias::ReceiverPlane { meters }),
    ]
}

fn either<T: Clone + Debug + 'static>(options: [T; 2]) -> impl Strategy<Value = T> {
    prop::sample::select(options.to_vec())
}

fn comparison() -> impl Strategy<Value = Comparison> {
    (
        bias(),
        either([DepthDistribution::Hyperbolic, DepthDistribution::Linear]),
        either([CasterFaces::Front, CasterFaces::Back]),
        either([WarpAxis::View, WarpAxis::BodyCenter]),
        either([CasterCulling::Hull, CasterCulling::Off]),
        either([ShadowFocus::Receivers, ShadowFocus::Off]),
        either([MapUpdates::WhenNeeded, MapUpdates::EveryFrame]),
    )
        .prop_map(
            |(bias, depth, caster_faces, warp_axis, culling, focus, updates)| Comparison {
                bias,
                depth,
                caster_faces,
                warp_axis,
                culling,
                focus,
                updates,
            },
        )
}

fn config() -> impl Strategy<Value = ParallelSplitShadows> {
    let range = (number(0.0..10.0), number(10.0..2000.0));
    let shares = (number(0.0..0.5), number(0.0..1.0), number(0.0..1.0));
    let lookups = (
        filter(),
        either([CascadeTransition::CrossFade, CascadeTransition::Dither]),
    );
    let motion = (
        either([TexelGrid::Light, TexelGrid::Ground]),
        number(0.0..1.0),
        count(0..61),
        prop_oneof![
            count(1..5).prop_map(UpdateBudget::Maps),
            (1..u32::MAX).prop_map(UpdateBudget::Texels),
        ],
    );
    (
        count(1..5),
        range,
        splits(),
        shares,
        fit(),
        map_size(),
        lookups,
        motion,
        comparison(),
    )
        .prop_map(
            |(cascades, range, splits, shares, fit, map_size, lookups, motion, comparison)| {
                let ((near, far), (blend, fade, slack)) = (range, shares);
                let ((filter, transition), (grid, sun_step, delay, update_budget)) =
                    (lookups, motion);
                ParallelSplitShadows {
                    cascades,
                    near,
                    far,
                    splits,
                    blend,
                    fade,
                    fit,
                    slack,
                    map_size,
                    filter,
                    grid,
                    sun_step,
                    delay,
                    update_budget,
                    transition,
                    comparison,
                }
            },
        )
}

/// The last good settings are in force, and all that is published can be drawn.
fn is_sound(app: &App, light: Entity, last_good: &ParallelSplitShadows) -> Outcome {
    let light = app.world().entity(light);
    let managed = light.get::<ManagedLight>().expect("managed");
    prop_assert_eq!(managed.config(), Some(last_good));
    let plans = light.get::<ShadowPlans>().expect("managed");
    are_finite(plans.views.values().flatten())?;
    let cascades = light.get::<Cascades>().expect("a light");
    for cascade in cascades.cascades.values().flatten() {
        for matrix in [
            cascade.world_from_cascade,
            cascade.clip_from_cascade,
            cascade.clip_from_world,
        ] {
            prop_assert!(matrix.is_finite(), "{matrix}");
        }
    }
    Ok(())
}

#[test]
fn what_is_written_while_the_app_runs_is_taken_if_it_is_good() {
    let mut app = app();
    camera(&mut app);
    let light = sun(&mut app, ParallelSplitShadows::default());
    app.update();
    let state = RefCell::new((app, ParallelSplitShadows::default()));
    // Of no number of its own, so that `PROPTEST_CASES` says how many.
    let mut runner = TestRunner::new(ProptestConfig {
        failure_persistence: None,
        // In an app that has failed once, smaller settings prove nothing.
        max_shrink_iters: 0,
        ..ProptestConfig::default()
    });
    let outcome = runner.run(&(config(), any::<bool>()), |(config, is_inserted)| {
        let mut state = state.borrow_mut();
        let (app, last_good) = &mut *state;
        if config.validate(MAX_MAP_SIZE).is_ok() {
            last_good.clone_from(&config);
        }
        let mut entity = app.world_mut().entity_mut(light);
        if is_inserted {
            entity.insert(config);
        } else {
            let written = entity.get_mut::<ParallelSplitShadows>();
            *written.expect("a component") = config;
        }
        for _ in 0..2 {
            app.update();
            is_sound(app, light, last_good)?;
        }
        Ok(())
    });
    if let Err(error) = outcome {
        panic!("{error}");
    }
}
