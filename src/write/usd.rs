//! The USD override layer.
