//! Which casters have changed, and what that is to maps.

use crate::geometry::{hull::CasterHull, oriented_box::OrientedBox};

/// Casters that have changed since the last plan.
#[derive(Debug, Clone, PartialEq, Default)]
pub enum CasterChanges {
    /// Some, nobody knows where.
    #[default]
    Anywhere,
    /// Where they were, and where they are.
    At(Vec<OrientedBox>),
    /// The same, or `None` for anywhere: some are drawn over maps no more, and are in none yet. Maps that are to
    /// hold them cannot wait.
    AtOnce(Option<Vec<OrientedBox>>),
    /// Some have come, and no map holds them yet: they can be drawn over what maps hold.
    Come {
        /// Where others were that have changed, and where they are.
        changed: Vec<OrientedBox>,
        /// Where those are that have come.
        come: Vec<OrientedBox>,
        /// Some of them were drawn over maps, and are no more: maps that are to hold them cannot wait.
        is_urgent: bool,
    },
}

impl CasterChanges {
    /// Whether none has changed.
    pub fn are_none(&self) -> bool {
        matches!(self, Self::At(changed) if changed.is_empty())
    }

    /// Whether maps that are to hold what has changed or come cannot wait.
    pub(super) fn are_urgent(&self) -> bool {
        match self {
            Self::Anywhere | Self::At(_) => false,
            Self::AtOnce(_) => true,
            Self::Come { is_urgent, .. } => *is_urgent,
        }
    }

    /// Whether any have changed where casters matter, but for those that have come.
    pub(super) fn meet(&self, hull: &CasterHull) -> bool {
        match self {
            Self::Anywhere | Self::AtOnce(None) => true,
            Self::At(changed) | Self::AtOnce(Some(changed)) | Self::Come { changed, .. } => {
                meet(changed, hull)
            }
        }
    }

    /// Whether any have come where casters matter.
    pub(super) fn come_to(&self, hull: &CasterHull) -> bool {
        match self {
            Self::Anywhere | Self::At(_) | Self::AtOnce(_) => false,
            Self::Come { come, .. } => meet(come, hull),
        }
    }
}

fn meet(casters: &[OrientedBox], hull: &CasterHull) -> bool {
    casters.iter().any(|bounds| hull.intersects_box(bounds))
}
