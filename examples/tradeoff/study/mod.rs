//! Measuring shadow settings in a scene: how wrong they are against rays, and what they cost.

#![allow(dead_code, reason = "shared with the tests")]

pub mod alternatives;
pub mod cases;
pub mod cost;
pub mod day;
pub mod drawn;
pub mod faults;
pub mod flicker;
pub mod maps;
pub mod path;
pub mod paths;
pub mod pictures;
pub mod row;
pub mod run;
pub mod settings;
pub mod studio;
pub mod tune;

pub use crate::truth::{accuracy, gather, light, trace};
