//! Authored charts packed anew: their cuts and shapes stay, their places and sizes are ours.
//!
//! That mends what lies in the packing: charts on top of each other, outside of 0..1, too near for the padding, or of uneven
//! density. Mirrored charts are turned over. Triangles without UV area, or mirrored within their chart, are charted by projection;
//! a chart that overlaps itself is parted.

use super::chart::{self, Chart};
use super::findings::{AuthoredUvs, Verdict};
use super::shape::Shape;
use super::{UnwrapParams, authored};
use crate::error::Result;
use crate::progress::Progress;
use crate::scene::Scene;
use rayon::prelude::*;

/// The charts of a mesh, and what its UVs were like.
pub type Repacked = (Vec<Chart>, AuthoredUvs);

/// The authored charts of each of the meshes `which`, whose shapes are `shapes`, and what its UVs were like; none for a mesh
/// without finite ones.
///
/// # Errors
/// `Cancelled`.
pub fn charts(
    scene: &Scene,
    users: &[Vec<usize>],
    which: &[usize],
    shapes: &[Shape],
    params: &UnwrapParams,
    progress: &dyn Progress,
) -> Result<Vec<Option<Repacked>>> {
    let names = params.set_names();
    let repack = |(&m, shape): (&usize, &Shape)| {
        progress.check()?;
        let mesh = &scene.meshes[m];
        let found = names.iter().find_map(|&n| mesh.uv_set(n).map(|coords| (n, coords)));
        let Some((name, coords)) = found.filter(|(_, coords)| coords.iter().all(|p| p.is_finite())) else {
            return Ok(None);
        };
        let finding = AuthoredUvs::measure(scene, users[m][0], name, coords, Verdict::Repacked);
        let of = authored::charts(mesh, coords);
        let mut members: Vec<Vec<u32>> = vec![Vec::new(); of.iter().max().map_or(0, |c| *c as usize + 1)];
        of.iter().zip(0..).for_each(|(&c, t)| members[c as usize].push(t));
        let (mut charts, mut rejected) = (Vec::new(), Vec::new());
        for triangles in members {
            let uv = |&t: &u32| mesh.triangles[t as usize].map(|v| coords[v as usize].as_dvec2());
            let uv = triangles.iter().map(uv).collect();
            charts.extend(chart::authored(shape, triangles, uv, &mut rejected));
        }
        charts.extend(chart::projected(shape, &rejected));
        progress.advance(mesh.triangles.len() as u64);
        Ok(Some((charts, finding)))
    };
    which.par_iter().zip(shapes).map(repack).collect()
}
