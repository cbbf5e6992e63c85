//! Parallel-split shadow maps for Bevy.
