//! Form factors: how much of what leaves one patch arrives at another.

pub mod analytic;
