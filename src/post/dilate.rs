//! Gutters.
