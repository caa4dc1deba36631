//! Random numbers and the shapes they are warped to.

pub mod discrete;
pub mod numbers;
pub mod octahedral;
pub mod sequence;
pub mod spherical;
pub mod warp;

pub use discrete::Discrete;
pub use numbers::{Drawn, Numbers, Random};
pub use sequence::Sequence;
pub use spherical::SphericalTriangle;
