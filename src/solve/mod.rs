//! Solving the balance `B_i = M_i + rho_i (E0_i + sum_j F_ij B_j)` over elements.

pub mod convergence;
pub mod progressive;

pub use progressive::{Solution, SolveParams, solve};
