//! Subdivision surfaces: Catmull-Clark (Catmull and Clark 1978), Loop (Loop 1987) and bilinear refinement of polygon
//! meshes with creases, corners, boundaries, holes and face-varying values.
//!
//! A [`Cage`] is refined level by level; values ride along as rows of floats. Sharpness follows DeRose, Kass and Truong,
//! *Subdivision surfaces in character animation* (1998), with uniform creasing: an edge of sharpness s is sharp for s
//! levels, and in the last, fractional one a blend. From [`INFINITE`] on it stays sharp. At the end vertices can be pushed
//! to the limit surface (Halstead, Kass and DeRose 1993 for Catmull-Clark; Loop's thesis for Loop).
//!
//! Face-varying values are a cage of their own ([`Cage::channel`]): its vertices are values, its faces the mesh's, and where
//! two faces disagree along an edge it has a boundary. One set of rules serves both.
//!
//! Each level has four times the faces of the one above. Cost and memory are linear in the faces of the last level.

mod adjacency;
mod cage;
mod channel;
mod limit;
mod refine;

pub use cage::{Boundary, Cage, INFINITE, Rules, Scheme, TriangleRule, Values};
pub use channel::Linear;
pub use limit::{Normals, smooth_normals};
