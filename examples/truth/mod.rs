//! The sun's light as rays have it, and what is wrong with pictures of it.

#![allow(dead_code, reason = "shared by several binaries")]

pub mod accuracy;
pub mod gather;
pub mod light;
pub mod trace;
