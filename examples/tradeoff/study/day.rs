//! A sun that moves: what changes where the truth does not.
//!
//! The camera rests, so a pixel is a point. Points count that face the sun and are lit, or in shadow, at every
//! one of some instants of the interval, and of some time before and after, for edges about to pass have no rest:
//! whenever their answer changes, that is the shadows' doing.

use bevy::{math::DVec3, platform::sync::Arc, prelude::*};
use bevy_pssm::{ShadowPlans, prelude::*};
use serde::Serialize;

use super::{
    accuracy::{Accuracy, Truth},
    light::Reference,
    settings::{Setting, Stock},
    studio::{Stance, Studio},
    trace::{Sample, Tracer},
};

/// Frames per second.
const RATE: f64 = 60.0;
/// Shares of an interval at which all of the picture is held against rays.
const LOOKS: [f64; 3] = [0.125, 0.5, 0.875];
/// Pictures before it, for what depends on what was.
const BEFORE: usize = 4;
/// Before it and after it, so much of it belongs to it where points are chosen.
const AROUND: f64 = 0.25;
/// Of its instants, so many are traced.
const INSTANTS: usize = 9;
/// Points are so many pixels apart, both ways.
const STRIDE: usize = 1;

/// A stretch of a sun's way.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// As in tables.
    pub name: &'static str,
    /// Where it begins, above the horizon (degrees).
    elevation: f64,
    /// How far it goes in a second (degrees).
    speed: f64,
    pictures: usize,
    /// Frames from one picture to the next.
    apart: usize,
}

impl Interval {
    /// All: of days of twenty minutes, of two, and of twenty-four hours.
    pub const ALL: [Self; 5] = [
        Self::new("12°, 0.3°/s", 12.0, 0.3, 180, 1),
        Self::new("35°, 0.3°/s", 35.0, 0.3, 180, 1),
        Self::new("zenith, 0.3°/s", 89.55, 0.3, 180, 1),
        Self::new("35°, 3°/s", 35.0, 3.0, 80, 1),
        // Half a second from picture to picture, forty in all.
        Self::new("35°, 15°/h", 35.0, 15.0 / 3600.0, 80, 30),
    ];

    const fn new(
        name: &'static str,
        elevation: f64,
        speed: f64,
        pictures: usize,
        apart: usize,
    ) -> Self {
        Self {
            name,
            elevation,
            speed,
            pictures,
            apart,
        }
    }

    fn seconds(self) -> f64 {
        (self.pictures * self.apart) as f64 / RATE
    }

    /// The picture at a share of it.
    fn picture(self, share: f64) -> usize {
        (self.pictures as f64 * share) as usize
    }

    /// How the sun stands at a picture, or on its way there: it goes up over where the scene's stands.
    fn to_sun(self, start: &Stance, frame: f64) -> DVec3 {
        let scenes = start.sun.back().as_dvec3();
        let level = (scenes * DVec3::new(1.0, 0.0, 1.0)).normalize_or(DVec3::X);
        // Not quite through the zenith.
        let level = (level + 0.02 * level.cross(DVec3::Y)).normalize();
        let seconds = frame * self.apart as f64 / RATE;
        let (sin, cos) = (self.elevation + self.speed * seconds)
            .to_radians()
            .sin_cos();
        (level * cos + DVec3::Y * sin + 0.002 * level.cross(DVec3::Y)).normalize()
    }

    fn stance(self, start: &Stance, frame: f64) -> Stance {
        let to_sun = self.to_sun(start, frame).as_vec3();
        Stance {
            sun: Transform::default().looking_to(-to_sun, Vec3::X),
            ..start.clone()
        }
    }
}

/// A scene under a moving sun, and what is known of it before any setting is.
struct Course {
    interval: Interval,
    reference: Reference,
    /// By pixel.
    points: Vec<(usize, Sample)>,
    /// All of the pictures that are looked at.
    looks: [Truth; LOOKS.len()],
}

/// One line of `suns.csv`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SunRow {
    /// Name of the scene.
    pub scene: String,
    /// Name of the setting.
    pub setting: String,
    /// Name of the interval.
    pub interval: &'static str,
    /// Points whose answer changes though their truth does not, in percent per second.
    pub changed_pct_per_second: f64,
    /// Points whose answer is not the truth, on average over some frames (percent).
    pub wrong_pct: f64,
    /// 95th percentile of how far true and found edges lie apart in them (pixels).
    pub edge_px_p95: f64,
    /// Maps drawn in a second.
    pub maps_per_second: f64,
}

/// Grids and steps, over a configuration; and Bevy's own.
pub fn sun_settings(config: &ParallelSplitShadows, stock: &[Stock]) -> Vec<Setting> {
    let mut settings = Vec::new();
    for grid in [TexelGrid::Light, TexelGrid::Ground] {
        for sun_step in [0.0, 0.02, 0.05, 0.2] {
            let config = ParallelSplitShadows {
                grid,
                sun_step,
                ..config.clone()
            };
            settings.push(Setting::pssm(format!("{grid:?} {sun_step}°"), config));
        }
        let config = ParallelSplitShadows {
            grid,
            filter: ShadowFilter::Hardware2x2,
            ..config.clone()
        };
        settings.push(Setting::pssm(format!("{grid:?} 0.05°, 2×2"), config));
    }
    for stock in stock {
        let name = if stock.tuned { "bevy tuned" } else { "bevy" };
        settings.push(Setting::bevy(name, *stock));
    }
    settings
}

impl Studio {
    /// Follows the sun under each setting, along each interval. `say` is told what is being done.
    pub fn under_moving_suns(
        &mut self,
        scene: &str,
        start: &Stance,
        settings: &[Setting],
        tracer: &Arc<Tracer>,
        mut say: impl FnMut(&str),
    ) -> Vec<SunRow> {
        say("tracing rays under moving suns");
        let courses = Interval::ALL.map(|interval| self.course(interval, start, tracer));
        let mut rows = Vec::new();
        for setting in settings {
            say(&format!("{} under moving suns", setting.name));
            self.apply(setting);
            for course in &courses {
                rows.push(self.follow_sun(scene, start, setting, course));
            }
        }
        rows
    }

    fn course(&mut self, interval: Interval, start: &Stance, tracer: &Arc<Tracer>) -> Course {
        let pictures = interval.pictures as f64;
        let middle = interval.stance(start, 0.5 * pictures);
        self.place(&middle);
        let reference = self.reference();
        let lens = self.lens();
        let to_sun = interval.to_sun(start, 0.5 * pictures);
        let mut points = tracer.every(&lens, to_sun, STRIDE);
        let suns: [DVec3; INSTANTS] = core::array::from_fn(|instant| {
            let share = instant as f64 / (INSTANTS - 1) as f64;
            let frame = pictures * ((1.0 + 2.0 * AROUND) * share - AROUND);
            interval.to_sun(start, frame)
        });
        points.retain(|(_, sample)| tracer.is_same_under(sample, &suns));
        let looks = LOOKS.map(|share| {
            let to_sun = interval.to_sun(start, interval.picture(share) as f64);
            let samples = tracer.picture(&lens, to_sun);
            let light = |sample: &Sample| f32::from(u8::from(sample.lit));
            let shares = samples.iter().map(|it| it.as_ref().map(light)).collect();
            Truth::new(lens, samples, shares)
        });
        Course {
            interval,
            reference,
            points,
            looks,
        }
    }

    fn follow_sun(
        &mut self,
        scene: &str,
        start: &Stance,
        setting: &Setting,
        course: &Course,
    ) -> SunRow {
        // A held map's picture is that of one drawn anew.
        self.set_updates(MapUpdates::WhenNeeded);
        self.forget();
        let interval = course.interval;
        let mut last: Vec<bool> = Vec::new();
        let (mut changed, mut wrong, mut maps) = (0, 0, 0);
        let mut accuracy = Accuracy::default();
        let looks = LOOKS.map(|share| BEFORE + interval.picture(share));
        for frame in 0..BEFORE + interval.pictures {
            let at = frame as f64 - BEFORE as f64;
            for way in 1..interval.apart {
                let share = way as f64 / interval.apart as f64;
                self.pass(&interval.stance(start, at - 1.0 + share));
                maps += usize::from(frame >= BEFORE) * self.maps_drawn();
            }
            self.place(&interval.stance(start, at));
            let picture = self.expose();
            if frame < BEFORE {
                continue;
            }
            maps += self.maps_drawn();
            let shares = course.reference.shares(&picture);
            let answers: Vec<bool> = course
                .points
                .iter()
                .map(|(pixel, _)| shares[*pixel].is_none_or(|share| share > 0.5))
                .collect();
            changed += last.iter().zip(&answers).filter(|(a, b)| a != b).count();
            if let Some(look) = looks.iter().position(|look| *look == frame) {
                accuracy.add(&course.looks[look], &shares);
                let points = course.points.iter().zip(&answers);
                wrong += points
                    .filter(|((_, sample), lit)| sample.lit != **lit)
                    .count();
            }
            last = answers;
        }
        self.set_updates(MapUpdates::EveryFrame);
        let points = course.points.len().max(1) as f64;
        let seconds = interval.seconds();
        let rounded = |value: f64| (1e4 * value).round() / 1e4;
        SunRow {
            scene: scene.to_owned(),
            setting: setting.name.clone(),
            interval: interval.name,
            changed_pct_per_second: rounded(100.0 * changed as f64 / points / seconds),
            wrong_pct: rounded(100.0 * wrong as f64 / points / LOOKS.len() as f64),
            edge_px_p95: rounded(accuracy.figures().edge_px_p95),
            maps_per_second: rounded(maps as f64 / seconds),
        }
    }

    /// Maps that the plugin has to draw in this frame; all of Bevy's.
    fn maps_drawn(&mut self) -> usize {
        let (camera, sun, ours) = (self.camera, self.sun, self.is_ours());
        let plans = self.world().get::<ShadowPlans>(sun);
        let Some(plans) = plans
            .filter(|_| ours)
            .and_then(|plans| plans.views.get(&camera))
        else {
            return 4;
        };
        let maps = plans.iter().filter_map(|plan| plan.map.as_ref());
        maps.filter(|map| map.redraw.is_some()).count()
    }
}
