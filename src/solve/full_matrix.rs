//! The full matrix (Goral, Torrance, Greenberg, Battaile 1984): (I - F rho) E = F B0, decomposed and solved directly for each
//! channel. Cost: n^3 / 3 operations and 8 n^2 bytes a channel.

use super::{Exchange, MOST_FULL_MATRIX, Step, System};
use crate::color::Rgb;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::transport::{Exchanger, Rows};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

/// Solves `system`, all bounces at once.
///
/// # Errors
/// `Invalid` where there are more than [`MOST_FULL_MATRIX`] elements; `Cancelled`.
pub fn solve(system: &System, rows: &mut Rows, progress: &dyn Progress) -> Result<Exchange> {
    let n = system.elements.len();
    refuse_too_many(n)?;
    let first = rows.gather(system.start, progress)?;
    let rows = &*rows;
    let albedo = &system.elements.albedo;
    let of_channel = |c: usize| -> Result<Vec<f64>> {
        progress.check()?;
        let mut matrix = DMatrix::<f64>::identity(n, n);
        for i in 0..n {
            let row = rows.kept(i).expect("rows of so few elements are all kept");
            for &(j, f) in &row.links {
                matrix[(i, j as usize)] -= f64::from(f) * f64::from(row.scale) * f64::from(albedo[j as usize][c]);
            }
        }
        let right = DVector::from_iterator(n, first.iter().map(|e| f64::from(e[c])));
        progress.check()?;
        // Its rows are diagonally dominant, as albedos are below 1 and rows add up to 1 at most: it has an inverse.
        let solution = matrix.lu().solve(&right);
        let solution = solution.ok_or_else(|| Error::invalid("full-matrix", "the matrix is singular"))?;
        Ok(solution.as_slice().to_vec())
    };
    let channels: Vec<Vec<f64>> = (0..3).into_par_iter().map(of_channel).collect::<Result<_>>()?;
    let received = (0..n).map(|i| Rgb::from_array([0, 1, 2].map(|c| channels[c][i] as f32))).collect();
    let step = Step { iteration: 1, residual: 0.0, unshot: 0.0 };
    Ok(Exchange { received, iterations: 1, steps: vec![step], ..Exchange::default() })
}

/// Refuses more elements than the full matrix takes.
///
/// # Errors
/// `Invalid` with the range that is allowed.
pub fn refuse_too_many(elements: usize) -> Result<()> {
    if elements <= MOST_FULL_MATRIX {
        return Ok(());
    }
    let message = format!(
        "full-matrix takes 1 to {MOST_FULL_MATRIX} elements, and there are {elements}: memory grows with their square and time \
         with their cube; use fewer with --elements, or another solver"
    );
    Err(Error::invalid("solver", message))
}
