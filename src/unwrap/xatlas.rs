//! xatlas
