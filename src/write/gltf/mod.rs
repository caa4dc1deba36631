//! GLBs.
