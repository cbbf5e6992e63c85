//! How a control is set.

use bevy::{light::ShadowFilteringMethod, prelude::*};
use bevy_pssm::prelude::*;

use super::{
    super::{
        open::Source,
        settings,
        sides::{Side, Technique},
    },
    Control, Controls, To,
    lines::{FILTERS, OVERLAYS, RESOLUTIONS, filter_index, overlay, overlay_index},
};
use crate::scene::SCENES;

impl Controls<'_, '_> {
    /// Sets a control.
    pub fn set(&mut self, control: &Control, to: &To) {
        match control {
            Control::Edited => {
                self.compare.edited = match next(to, self.compare.edited.index(), 2) {
                    0 => Side::Left,
                    _ => Side::Right,
                };
                if self.compare.edited == Side::Right {
                    self.compare.wipe.get_or_insert(0.5);
                }
            }
            Control::Technique => {
                let side = self.compare.edited.index();
                let technique = match next(to, self.compare.techniques[side] as usize, 3) {
                    0 => Technique::Plugin,
                    1 => Technique::BuiltIn,
                    _ => Technique::Tuned,
                };
                self.compare.techniques[side] = technique;
            }
            Control::Comparing => {
                let wipe = flag(to, self.compare.wipe.is_some()).then_some(0.5);
                self.compare.wipe = wipe;
                if wipe.is_none() {
                    self.compare.edited = Side::Left;
                }
            }
            Control::Wipe => {
                let now = self.compare.wipe.unwrap_or(0.5);
                self.compare.wipe = Some(value(to, now, 0.5).clamp(0.0, 1.0));
            }
            Control::Heading(_) => {}
            Control::Truth => self.truth.on = flag(to, self.truth.on),
            Control::Overlay => {
                *self.overlay = overlay(next(to, overlay_index(*self.overlay), OVERLAYS.len()));
            }
            Control::Counters => self.counters.on = flag(to, self.counters.on),
            Control::Maps => self.maps.on = flag(to, self.maps.on),
            Control::Frozen => self.frozen.on = flag(to, self.frozen.on),
            Control::Scene => {
                let chosen = next(to, self.opened.scene_index(), SCENES.len());
                if let Some(name) = SCENES.get(chosen) {
                    self.opened.open(Source::Shipped((*name).into()));
                }
            }
            Control::Path => {
                let flies = flag(to, self.flight.seconds.is_some());
                self.flight.seconds = flies.then_some(0.0);
            }
            Control::Resolution => {
                let now = self.pictures.coarseness.max(1).ilog2() as usize;
                self.pictures.coarseness = 1 << next(to, now, RESOLUTIONS.len()).min(2);
            }
            Control::Filter => {
                for (mut filter, _) in &mut self.camera {
                    *filter = match next(to, filter_index(*filter), FILTERS.len()) {
                        0 => ShadowFilteringMethod::Hardware2x2,
                        1 => ShadowFilteringMethod::Gaussian,
                        _ => ShadowFilteringMethod::Temporal,
                    };
                }
            }
            Control::ViewEnd => {
                for (_, mut lens) in &mut self.camera {
                    if let Projection::Perspective(lens) = &mut *lens {
                        lens.far = value(to, lens.far, 1000.0).max(1.01 * lens.near);
                    }
                }
            }
            Control::Azimuth | Control::Elevation => self.turn_sun(control, to),
            Control::Wandering => {
                self.moving.0 = flag(to, self.moving.0);
                self.day.hour = self.day.hour.filter(|_| !self.moving.0);
            }
            Control::Day => {
                if flag(to, self.day.hour.is_some()) != self.day.hour.is_some() {
                    self.day.toggle();
                    self.moving.0 = false;
                }
            }
            Control::Hour => {
                let hour = self.day.hour.unwrap_or(12.0);
                self.day.hour = Some(value(to, hour, 12.0).rem_euclid(24.0));
            }
            Control::DayMinutes => self.day.minutes = value(to, self.day.minutes, 2.0).max(0.1),
            Control::Preset => {
                let (now, count) = (self.presets.chosen, self.presets.names.len());
                self.presets.choose(match to {
                    // The first stands for none.
                    To::Next => 1 + now % count.saturating_sub(1).max(1),
                    _ => next(to, now, count),
                });
            }
            Control::CopyRon | Control::SavePreset => {
                let shadows = self.shadows(self.compare.edited).cloned();
                if let Some(shadows) = shadows {
                    self.presets.keep(&shadows, *control == Control::SavePreset);
                }
            }
            Control::Setting(path) => {
                let (path, to) = (path.clone(), to.clone());
                self.change_shadows(|shadows| match to {
                    To::Number(number) => settings::set_number(shadows, &path, number),
                    To::Choice(chosen) => settings::choose(shadows, &path, chosen),
                    To::Next => settings::choose_next(shadows, &path),
                    To::Default => settings::reset(shadows, &path),
                    To::Flag(_) => {}
                });
            }
        }
    }

    fn change_shadows(&mut self, change: impl FnOnce(&mut ParallelSplitShadows)) {
        let edited = self.compare.edited;
        let sun = self.suns.iter_mut().find(|(sun, ..)| sun.0 == edited);
        if let Some((_, shadows, kept)) = sun {
            match (shadows, kept) {
                (Some(mut shadows), _) => change(&mut shadows),
                (None, Some(mut kept)) => change(&mut kept.0),
                (None, None) => {}
            }
        }
    }

    fn turn_sun(&mut self, control: &Control, to: &To) {
        for (mut sun, mut transform) in &mut self.sun {
            if *control == Control::Azimuth {
                // The sky has turned with it.
                let own = sun.description.azimuth;
                sun.wandered = value(to, own + sun.wandered, own).rem_euclid(360.0) - own;
            } else {
                let elevation = value(to, sun.description.elevation, 40.0);
                sun.description.elevation = elevation.clamp(-90.0, 90.0);
            }
            *transform = sun.transform();
        }
    }
}

fn next(to: &To, now: usize, count: usize) -> usize {
    match to {
        To::Choice(chosen) => *chosen,
        To::Next => (now + 1) % count.max(1),
        _ => 0,
    }
}

fn flag(to: &To, now: bool) -> bool {
    match to {
        To::Flag(flag) => *flag,
        To::Next => !now,
        _ => false,
    }
}

fn value(to: &To, now: f32, default: f32) -> f32 {
    match to {
        To::Number(number) if number.is_finite() => *number,
        To::Default => default,
        _ => now,
    }
}
