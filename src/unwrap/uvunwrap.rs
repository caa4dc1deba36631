//! Charts by the `uvunwrap` crate: regions grown from the largest flat ones, flattened by least squares conformal maps (Lévy et
//! al. 2002) and then as rigidly as possible (Liu et al. 2008), so that texels are nearly even within a chart.
//!
//! It packs as well; here it does so in the quickest way and coarsely, since [`super::pack`] packs: what counts of its result are
//! the charts, which keep their proportions. Its conjugate gradients use IEEE arithmetic alone: equal input gives equal bits on
//! every platform, on any number of threads.

use super::part::{Part, Unwrapped};
use crate::error::{Error, Result};
use crate::progress::Progress;
use ::uvunwrap::{Density, MeshInput, Options, Packing, generate_with_progress};
use std::collections::HashMap;

/// Texels per unit of its own pages, edges being about 1 long: enough for charts to lie apart.
const DENSE: f32 = 4.0;

/// Charts and flattens `part`. What it can't take comes back without charts.
///
/// # Errors
/// `Cancelled`.
pub fn unwrap_part(part: &Part, progress: &dyn Progress) -> Result<Unwrapped> {
    let mut result = Unwrapped::none(part.triangles.len());
    let indices = part.triangles.as_flattened();
    let mesh = MeshInput { polygons: Some(&part.polygons), ..MeshInput::new(&part.positions, indices) };
    let options = Options {
        density: Density::Fixed { texels_per_unit: DENSE, page_size: None },
        padding: 0,
        packing: Packing::Fast,
        ..Options::default()
    };
    let atlas = match generate_with_progress(&[mesh], &options, |_| !progress.cancelled()) {
        Ok(atlas) => atlas,
        Err(_) if progress.cancelled() => return Err(Error::Cancelled),
        // The caller projects what has no chart.
        Err(error) => {
            tracing::debug!("uvunwrap left {} triangles out: {error}", part.triangles.len());
            return Ok(result);
        }
    };
    let Some(mesh) = atlas.meshes.first() else { return Ok(result) };
    let size = [f64::from(atlas.width), f64::from(atlas.height)];
    let mut number = HashMap::new();
    for (t, corners) in mesh.indices.chunks_exact(3).enumerate().take(part.triangles.len()) {
        let vertices = [0, 1, 2].map(|k| mesh.vertices[corners[k] as usize]);
        let Some(chart) = vertices[0].chart.filter(|c| vertices.iter().all(|v| v.chart == Some(*c))) else { continue };
        let next = number.len() as u32;
        result.chart[t] = *number.entry(chart).or_insert(next);
        result.uv[t] = vertices.map(|v| [0, 1].map(|k| f64::from(v.uv[k]) * size[k]));
    }
    result.chart_count = number.len() as u32;
    Ok(result)
}
