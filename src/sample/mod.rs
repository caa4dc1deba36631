//! Random numbers and the shapes they are warped to.

pub mod discrete;
pub mod sequence;
pub mod warp;

pub use discrete::Discrete;
pub use sequence::Sequence;
