//! What is compared.

use bevy::{light::CascadeShadowConfig, light::CascadeShadowConfigBuilder, prelude::*};
use bevy_pssm::prelude::*;

/// A way to draw the sun's shadows.
#[derive(Debug, Clone)]
pub struct Setting {
    /// Name, unique among the settings of a scene.
    pub name: String,
    /// Whose shadows, and how.
    pub technique: Technique,
}

/// Whose shadows.
#[derive(Debug, Clone)]
pub enum Technique {
    /// The plugin's.
    Pssm(ParallelSplitShadows),
    /// Bevy's own.
    Bevy(Stock),
}

/// Settings of Bevy's own shadows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stock {
    /// Texels per side of each of four maps.
    pub map_size: u32,
    /// Where the first cascade is taken to begin, as for the plugin's (meters); Bevy's reaches to
    /// the eye, as the plugin's does.
    pub near: f32,
    /// Where the first cascade ends (meters).
    pub first_far: f32,
    /// Where the last one ends (meters).
    pub far: f32,
    /// `DirectionalLight::shadow_depth_bias`.
    pub depth_bias: f32,
    /// `DirectionalLight::shadow_normal_bias`.
    pub normal_bias: f32,
    /// Whether these are no longer Bevy's defaults.
    pub tuned: bool,
}

impl Stock {
    /// Bevy's defaults, over a preset's distances.
    pub fn new(map_size: u32, preset: &ParallelSplitShadows) -> Self {
        let far = preset.far;
        Self {
            map_size,
            near: preset.near,
            first_far: CascadeShadowConfigBuilder::default().first_cascade_far_bound,
            far,
            depth_bias: DirectionalLight::DEFAULT_SHADOW_DEPTH_BIAS,
            normal_bias: DirectionalLight::DEFAULT_SHADOW_NORMAL_BIAS,
            tuned: false,
        }
    }

    /// The light's component.
    pub fn cascades(&self) -> CascadeShadowConfig {
        CascadeShadowConfigBuilder {
            num_cascades: 4,
            first_cascade_far_bound: self.first_far,
            maximum_distance: self.far,
            ..default()
        }
        .build()
    }
}

impl Setting {
    /// One of the plugin's.
    pub fn pssm(name: impl Into<String>, config: ParallelSplitShadows) -> Self {
        Self {
            name: name.into(),
            technique: Technique::Pssm(config),
        }
    }

    /// One of Bevy's.
    pub fn bevy(name: impl Into<String>, stock: Stock) -> Self {
        Self {
            name: name.into(),
            technique: Technique::Bevy(stock),
        }
    }

    /// The setting in words: RON ready to paste, or Bevy's parameters.
    pub fn ron(&self) -> String {
        match &self.technique {
            Technique::Pssm(config) => ron::to_string(config).unwrap_or_default(),
            Technique::Bevy(stock) => format!(
                "{}², first bound {} m, normal bias {}, depth bias {}",
                stock.map_size, stock.first_far, stock.normal_bias, stock.depth_bias
            ),
        }
    }

    /// Whether it is one of Bevy's, tuned.
    pub fn is_tuned(&self) -> bool {
        matches!(self.technique, Technique::Bevy(stock) if stock.tuned)
    }

    /// `bevy` or `pssm`, as in tables.
    pub fn technique_name(&self) -> &'static str {
        match self.technique {
            Technique::Pssm(_) => "pssm",
            Technique::Bevy(_) => "bevy",
        }
    }
}

/// The plugin's settings that are compared unless others are asked for, over the distances of a
/// scene's own preset.
pub fn grid(preset: &ParallelSplitShadows, quick: bool) -> Vec<Setting> {
    let base = ParallelSplitShadows {
        near: preset.near,
        far: preset.far,
        ..default()
    };
    let sizes = map_sizes(quick);
    let with = |change: &dyn Fn(&mut ParallelSplitShadows)| {
        let mut config = base.clone();
        change(&mut config);
        config
    };
    let mut settings = Vec::new();
    for (name, fit) in [
        ("steady", CascadeFit::Steady),
        ("stable", CascadeFit::Stable),
        ("tight", CascadeFit::Tight),
        ("warped", CascadeFit::Warped(MapWarp::Minimax)),
    ] {
        // Of the other fits a few sizes are enough, and quickly one.
        let sizes = match fit {
            CascadeFit::Steady => sizes,
            CascadeFit::Stable => &[2048],
            _ => &sizes[usize::from(quick)..],
        };
        for size in sizes {
            let config = with(&|config| {
                config.fit = fit.clone();
                config.map_size = MapSize::Same(*size);
            });
            settings.push(Setting::pssm(format!("{name} {size}"), config));
        }
    }
    let steady = |name: &str, change: &dyn Fn(&mut ParallelSplitShadows)| {
        Setting::pssm(format!("steady 2048 {name}"), with(change))
    };
    for lambda in if quick { &[0.8][..] } else { &[0.7, 0.8, 0.95] } {
        settings.push(steady(&format!("lambda {lambda}"), &|config| {
            config.splits = SplitScheme::Practical { lambda: *lambda };
        }));
    }
    if quick {
        return settings;
    }
    let minimax = || CascadeFit::Warped(MapWarp::Minimax);
    let auto = |sharpness| CascadeFit::Auto { sharpness };
    for (name, fit) in [
        ("auto 2048", auto(1.0)),
        ("auto 2048 half", auto(0.5)),
        ("faces 2048", CascadeFit::Faces),
        ("warped 2048 lispsm", CascadeFit::Warped(MapWarp::Lispsm)),
        (
            "warped 2048 trapezoid",
            CascadeFit::Warped(MapWarp::Trapezoid { focus: 0.3 }),
        ),
    ] {
        let config = with(&|config| config.fit = fit.clone());
        settings.push(Setting::pssm(name, config));
    }
    let fitted = |name: &str, fit: CascadeFit, change: &dyn Fn(&mut ParallelSplitShadows)| {
        let mut config = with(change);
        config.fit = fit;
        Setting::pssm(name, config)
    };
    settings.extend([
        fitted("tight 2048 no slack", CascadeFit::Tight, &|config| {
            config.slack = 0.0;
        }),
        fitted("tight 2048 no focus", CascadeFit::Tight, &|config| {
            config.comparison.focus = ShadowFocus::Off;
        }),
        fitted("tight 2048 lambda 0.8", CascadeFit::Tight, &|config| {
            config.splits = SplitScheme::Practical { lambda: 0.8 };
        }),
        fitted("warped 2048 no focus", minimax(), &|config| {
            config.comparison.focus = ShadowFocus::Off;
        }),
        fitted("warped 2048 middle", minimax(), &|config| {
            config.comparison.warp_axis = WarpAxis::BodyCenter;
        }),
        fitted("warped 2048 lambda 0.8", minimax(), &|config| {
            config.splits = SplitScheme::Practical { lambda: 0.8 };
        }),
        fitted("warped 836", minimax(), &|config| {
            config.map_size = MapSize::Same(836);
        }),
        // As many texels as four maps of 2048².
        fitted("warped budget logarithmic", minimax(), &|config| {
            config.map_size = MapSize::Budget(4 * 2048 * 2048);
            config.splits = SplitScheme::Logarithmic;
        }),
        fitted("warped 2048 logarithmic", minimax(), &|config| {
            config.splits = SplitScheme::Logarithmic;
        }),
    ]);
    settings.extend([
        steady("logarithmic", &|config| {
            config.splits = SplitScheme::Logarithmic;
        }),
        steady("delay 4", &|config| config.delay = 4),
        steady("no blend", &|config| config.blend = 0.0),
        steady("no fade", &|config| config.fade = 0.0),
        steady("3 cascades", &|config| config.cascades = 3),
        steady("2 cascades", &|config| config.cascades = 2),
        Setting::pssm(
            "steady 4096 halving",
            with(&|config| config.map_size = MapSize::Halving(4096)),
        ),
        Setting::pssm(
            "steady 4096 near",
            with(&|config| {
                config.map_size =
                    MapSize::PerCascade(vec![[4096; 2], [4096; 2], [2048; 2], [2048; 2]]);
            }),
        ),
        steady("dithered", &|config| {
            config.transition = CascadeTransition::Dither;
        }),
    ]);
    let texels = FilterRadius::Texels;
    settings.extend(
        [
            ("2×2", ShadowFilter::Hardware2x2),
            ("tent 1.5", ShadowFilter::Tent(texels(1.5))),
            ("tent 2", ShadowFilter::Tent(texels(2.0))),
            ("tent 4", ShadowFilter::Tent(texels(4.0))),
            ("temporal", ShadowFilter::Temporal(texels(2.0))),
            ("soft", ShadowFilter::Soft { sun_degrees: 0.53 }),
        ]
        .map(|(name, filter)| steady(name, &|config| config.filter = filter)),
    );
    settings.extend(
        [
            ("constant bias", ShadowBias::Constant { meters: 0.2 }),
            (
                "slope-scaled bias",
                ShadowBias::SlopeScaled {
                    factor: 4.0,
                    meters: 0.02,
                },
            ),
            ("normal offset", ShadowBias::NormalOffset { texels: 3.0 }),
            ("receiver plane", ShadowBias::ReceiverPlane { meters: 0.05 }),
        ]
        .map(|(name, bias)| steady(name, &|config| config.comparison.bias = bias)),
    );
    settings
}

/// Sizes of maps that are compared (texels per side).
pub fn map_sizes(quick: bool) -> &'static [u32] {
    if quick {
        &[1024, 2048]
    } else {
        &[512, 1024, 2048, 4096]
    }
}
