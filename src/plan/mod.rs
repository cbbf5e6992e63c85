//! From a view, a light and a configuration to the cascades that will be drawn: one pure
//! function, no ECS, that calls [`geometry`](crate::geometry) in order.

mod changes;
mod choose;
mod cut;
mod held;
mod layout;
mod lookup;
mod map;
mod place;
mod rest;
mod size;
mod split;
mod stagger;
mod sun;
mod turning;
mod volume;
mod warp;

pub use changes::CasterChanges;
pub use held::Redraw;
pub use lookup::{bias_scales, filter_of, lookup_reach, over_own_range};
pub use split::split_planes;
pub use warp::{warp_direction, warp_frame};

use glam::{DMat4, DVec2, UVec2};

use crate::{
    config::{MAX_CASCADES, MapFit, ParallelSplitShadows},
    geometry::{
        aliasing::Aliasing,
        face::Wedge,
        fit::LookupReach,
        hull::CasterHull,
        hysteresis::{Hold, Kept, Slack},
        light_frame::LightFrame,
        receivers::Receivers,
        slice::ViewVolume,
    },
};

use held::HeldMap;
use layout::{KeptRange, Layout};
use place::Placing;
use rest::Rest;
use stagger::Turn;
use sun::FollowedSun;
use turning::Turning;

/// One cascade of one light for one view.
#[derive(Debug, Clone, PartialEq)]
pub struct CascadePlan {
    /// Depth at which the cascade takes over, blend band included (meters from the eye, along the view).
    pub near: f64,
    /// Depth at which it ends (meters from the eye, along the view).
    pub far: f64,
    /// Depth at which blending into the next cascade, or for the last one into light, begins (as the others).
    pub blend_start: f64,
    /// The part of the view's cross-section that it is for, if faces of the view have maps of their
    /// own; all cascades of a slice have the same depths.
    pub wedge: Option<Wedge>,
    /// Texels along the map's axes.
    pub map_size: UVec2,
    /// The map's extent; `None` if the camera sees nothing in this interval that receives shadows:
    /// no map at all.
    pub map: Option<CascadeMap>,
}

/// The extent of a cascade's map and which casters matter to it.
#[derive(Debug, Clone, PartialEq)]
pub struct CascadeMap {
    /// World space to the map's clip space: NDC z in [0, 1], greater towards the light; `w` is 1
    /// unless the map is warped, and above 0 wherever light can reach the body.
    pub clip_from_world: DMat4,
    /// The cascade's own frame (x, y along the map, z to the light, origin on the near face) to
    /// clip space.
    pub clip_from_cascade: DMat4,
    /// The cascade's own frame to world space.
    pub world_from_cascade: DMat4,
    /// Size of a texel along the map's axes, where it is largest (meters; of maps that stand on the ground,
    /// meters of that).
    pub texel: DVec2,
    /// How the map is laid over its slice: as configured, or chosen.
    pub fit: MapFit,
    /// How strongly the map is warped (1/meters; the reciprocal of the distance from the center of
    /// projection to the body); 0 if it is not.
    pub strength: f64,
    /// Where casters can stand that matter to what receives shadows in the slice, until more are added to the map or
    /// it is drawn anew. What is added to holds those of earlier hulls too.
    pub hull: CasterHull,
    /// The same, in this frame.
    pub hull_now: CasterHull,
    /// The worst aliasing over what receives shadows, for a map of one texel and an image one pixel high
    /// (Lloyd et al. 2006, Eq. 1, perspective part). For the first cascade, from the
    /// configuration's `near` on: at the eye no map is large enough. `None` where the map has no
    /// image of a corner.
    pub aliasing: Option<Aliasing>,
    /// Why it is drawn in this frame; `None` if what was drawn last still serves.
    pub redraw: Option<Redraw>,
}

impl CascadePlan {
    /// Texels across a pixel where they are fewest, in an image `image_height` pixels high:
    /// below one, texels show. `None` without a map.
    pub fn texels_per_pixel(&self, image_height: f64) -> Option<f64> {
        let aliasing = self.map.as_ref()?.aliasing?;
        let pixels_per_texel = aliasing.pixels_per_texel(self.map_size.as_dvec2(), image_height);
        Some(pixels_per_texel.max_element().recip())
    }
}

/// What a plan is made from.
#[derive(Debug, Clone, Copy)]
pub struct PlanInputs<'a> {
    /// What the camera sees.
    pub view: &'a ViewVolume,
    /// The light's frame.
    pub light: &'a LightFrame,
    /// Must have passed [`ParallelSplitShadows::validate`].
    pub config: &'a ParallelSplitShadows,
    /// What lookups reach ([`lookup_reach`]).
    pub reach: LookupReach,
    /// What receives shadows before the camera.
    pub receivers: &'a Receivers,
    /// Height of the picture (pixels): no fit need be sharper.
    pub image_height: f64,
    /// Casters that have changed since the plan that the history is of.
    pub changes: &'a CasterChanges,
}

/// The settings' numbers, in the plan's precision.
impl PlanInputs<'_> {
    fn near(&self) -> f64 {
        f64::from(self.config.near)
    }

    fn far(&self) -> f64 {
        f64::from(self.config.far)
    }

    fn slack(&self) -> Slack {
        Slack(f64::from(self.config.slack))
    }
}

/// What fitted maps hold on to from frame to frame; one for each view of a light.
#[derive(Debug, Default, Clone, PartialEq)]
pub struct PlanHistory {
    /// What it was made with: another configuration starts anew.
    config: Option<ParallelSplitShadows>,
    /// The view that it was last made for, from the grids' origin.
    view: Option<ViewVolume>,
    view_before: Option<ViewVolume>,
    turning: Turning,
    /// Depth at which the first slice ended then.
    first_plane: f64,
    /// Depths between which splits are spread, and what is held of them.
    range: Option<[f64; 2]>,
    kept_range: KeptRange,
    /// Slices in use.
    slices: Option<usize>,
    /// Faces that each slice has room for.
    faces: Kept<f64>,
    cascades: [CascadeHistory; MAX_CASCADES],
    rest: Rest,
}

impl PlanHistory {
    fn new(config: &ParallelSplitShadows) -> Self {
        let mut history = Self {
            config: Some(config.clone()),
            faces: Kept::with(Hold {
                frames: Hold::LONG.frames,
                ..Hold::SHORT
            }),
            ..Self::default()
        };
        if config.fit.any(|fit| fit == MapFit::Steady) {
            history.kept_range = KeptRange::with(history.turning.depths());
            for cascade in &mut history.cascades {
                cascade.extent = [Kept::with(Hold::LONG); 2];
                cascade.size = [Kept::with(Hold::LONG); 2];
            }
        }
        history
    }

    /// Whether another configuration asks for the same maps: it may differ in how they are looked up, and when drawn.
    fn has_maps_for(&self, config: &ParallelSplitShadows) -> bool {
        self.config.as_ref().is_some_and(|known| {
            let alike = ParallelSplitShadows {
                fade: config.fade,
                filter: config.filter,
                transition: config.transition,
                sun_step: config.sun_step,
                delay: config.delay,
                update_budget: config.update_budget,
                ..known.clone()
            };
            alike == *config
        })
    }
}

#[derive(Debug, Default, Clone, PartialEq)]
struct CascadeHistory {
    /// Of what receives shadows, along the world's axes.
    bounds: [Kept<[f64; 2]>; 3],
    /// Of the same, in depth.
    depths: [Kept<f64>; 2],
    /// Of a steady or tight map (meters).
    extent: [Kept<f64>; 2],
    fit: Option<MapFit>,
    /// Of a map from a budget (texels).
    size: [Kept<f64>; 2],
    held: Option<HeldMap>,
    sun: FollowedSun,
}

impl CascadeHistory {
    /// Of the map that there is, or of the one that is to be, whichever are finer (meters).
    fn texel(&self) -> DVec2 {
        let held = self.held.as_ref().map(HeldMap::texel);
        held.map_or(self.sun.texel, |held| held.min(self.sun.texel))
    }

    /// Lets go of what the slice was; but for a steady map's extent, if that is to be held in some way.
    fn forget_slice(&mut self, hold: Option<Hold>) {
        self.bounds.iter_mut().for_each(Kept::forget);
        self.depths.iter_mut().for_each(Kept::forget);
        for extent in &mut self.extent {
            match hold.filter(|_| self.fit == Some(MapFit::Steady)) {
                Some(hold) => extent.hold_as(hold),
                None => extent.forget(),
            }
        }
    }

    /// The same where nothing is seen of it.
    fn miss_slice(&mut self, hold: Option<Hold>) {
        self.forget_slice(hold);
        self.extent.iter_mut().for_each(Kept::wait);
    }
}

/// Plans all cascades of a light for a view.
pub fn plan_cascades(inputs: &PlanInputs, history: &mut PlanHistory) -> Vec<CascadePlan> {
    let before = history.before(inputs);
    let plans = plan_from(inputs, history);
    history.note_rest(inputs, before.as_ref(), &plans);
    plans
}

fn plan_from(inputs: &PlanInputs, history: &mut PlanHistory) -> Vec<CascadePlan> {
    let config = inputs.config;
    if history.config.as_ref() != Some(config) {
        if history.has_maps_for(config) {
            history.config = Some(config.clone());
        } else {
            *history = PlanHistory::new(config);
        }
    }
    let view = cut::relative_to(inputs.view, inputs.light.origin);
    if let Some(last) = history.view.replace(view) {
        let before = history.view_before.replace(last);
        let is_cut = |from: &ViewVolume| cut::is_cut(inputs, from, &view, history.first_plane);
        // What is fast already goes on.
        let goes_on =
            |before| cut::goes_on(inputs, before, &last).is_some_and(|from| !is_cut(&from));
        if is_cut(&last) && !before.as_ref().is_some_and(goes_on) {
            *history = PlanHistory {
                view: Some(view),
                view_before: Some(last),
                ..PlanHistory::new(config)
            };
        } else {
            history.follow_turn(inputs, &last, &view);
        }
    }
    history.let_go_of_what_is_far(inputs);
    let range = layout::split_range(inputs, history.range, &mut history.kept_range);
    let slices = choose::slice_count(inputs, range, history.slices, &mut history.faces);
    let layout = Layout::new(inputs, range, slices);
    // Cascades of other slices have little to hold on to.
    let slices = layout.slices();
    let is_same = history.range.replace(range) == Some(range) && history.slices == Some(slices);
    if !is_same {
        let hold = history.turning.other_slices(layout.interval(0).1);
        for cascade in &mut history.cascades {
            cascade.forget_slice(hold);
        }
    }
    history.slices = Some(slices);
    history.first_plane = layout.interval(0).1;

    let kept = &mut history.cascades;
    let volumes = layout.volumes(inputs, kept);
    for (index, kept) in kept.iter_mut().enumerate() {
        if volumes.get(index).is_none_or(Option::is_none) {
            kept.miss_slice(history.turning.unseen_slices());
        }
    }
    let due = sun::due(inputs, kept);
    let mut frames: Vec<LightFrame> = volumes
        .iter()
        .enumerate()
        .map(|(index, volume)| match volume {
            Some(volume) => kept[index].sun.frame(inputs, volume.middle(), due[index]),
            None => *inputs.light,
        })
        .collect();
    // Of each cascade, with the frame that its map is laid in.
    let inputs_of: Vec<PlanInputs> = frames
        .iter()
        .map(|light| PlanInputs { light, ..*inputs })
        .collect();
    let fits: Vec<_> = volumes
        .iter()
        .enumerate()
        .map(|(index, volume)| {
            let inputs = &inputs_of[index];
            let (fit, _) = choose::fit(inputs, volume.as_ref(), index, kept[index].fit);
            kept[index].fit = Some(fit);
            fit
        })
        .collect();
    let sizes = size::map_sizes(&inputs_of, &layout, &volumes, &fits, kept);
    let mut placing = Placing {
        inputs,
        volumes: &volumes,
        fits: &fits,
        sizes: &sizes,
        frames: &mut frames,
    };
    let placed = placing.place_all(kept, &mut history.turning);
    let held = kept.iter().map(|kept| kept.held.as_ref());
    let mut turn = Turn::new(inputs.config.update_budget, held);
    placed
        .into_iter()
        .enumerate()
        .map(|(index, placed)| {
            let (near, far) = layout.interval(index);
            let map = placed.and_then(|placed| {
                let light = &frames[index];
                let inputs = PlanInputs { light, ..*inputs };
                let volume = volumes[index].as_ref()?;
                let held = &mut kept[index].held;
                held::hold(
                    &inputs,
                    volume,
                    placed,
                    (index, sizes[index]),
                    &mut turn,
                    held,
                )
            });
            if map.is_none() {
                kept[index].held = None;
            }
            CascadePlan {
                near,
                far,
                blend_start: layout.blend_start(index),
                wedge: layout.wedge(index),
                map_size: sizes[index],
                map,
            }
        })
        .collect()
}
