//! Lightmap UVs that the scene brings along.
//!
//! A set is sound when its UVs are finite, lie in 0..1, have area, and don't overlap. Where all surfaces have sound sets that
//! don't overlap each other either, the UVs are page coordinates as they stand; else each surface gets a rectangle for its set.

use super::findings::{AuthoredUvs, Verdict};
use super::layout::Content;
use super::mask;
use super::overlap::{Cells, bounds, centers};
use super::shape::Sets;
use super::{Atlas, Density, MeshUvs, Placement, UnwrapParams, UvMode, areas, surface_area};
use crate::error::{Error, Result, Warnings};
use crate::progress::Progress;
use crate::scene::{Mesh, Scene, Surface};
use glam::{DVec2, Vec2};
use rayon::prelude::*;
use std::ops::Range;

/// How far [UV] a coordinate may leave 0..1: rounding in exporters.
const RANGE_TOLERANCE: f32 = 1e-4;
/// Share of a mesh's area that may have UVs without area. The texels of such triangles are worthless, but
/// a few slivers are no reason to throw an artist's work away.
const SMALL_SHARE: f64 = 1e-3;
/// Surfaces whose samples are listed before they are held against those of others.
const SURFACES: usize = 64;
/// Bands of rows that a page is looked through in.
const BANDS: u32 = 16;
/// Samples along a side of the overlap check.
const SAMPLES: usize = 2048;

/// A sound authored set of one mesh.
#[derive(Clone, Debug)]
pub struct Set {
    pub uvs: MeshUvs,
    /// Bounds of the UVs.
    pub low: DVec2,
    pub high: DVec2,
    /// Metres for each unit of UV: root of area in space (of the largest surface) by area of the UVs.
    pub metres: f64,
}

impl Set {
    /// Its rectangle.
    pub fn content(&self) -> Content {
        Content::Authored { size: (self.high - self.low) * self.metres }
    }
}

/// The sound authored set of each mesh that has one, by mesh, and what those that were refused are like. None where all are new or
/// packed anew.
///
/// # Errors
/// `Invalid` under [`UvMode::Keep`], naming the first surface without a sound set and what is wrong; `Cancelled`.
pub fn sets(
    scene: &Scene,
    users: &[Vec<usize>],
    params: &UnwrapParams,
    warnings: &mut Warnings,
    progress: &dyn Progress,
) -> Result<(Vec<Option<Set>>, Vec<AuthoredUvs>)> {
    let (mut sets, mut refused) = (vec![None; users.len()], Vec::new());
    if matches!(params.uv, UvMode::New | UvMode::Repack) {
        return Ok((sets, refused));
    }
    let names = params.set_names();
    let named = |m: usize| names.iter().find_map(|&n| scene.meshes[m].uv_set(n).map(|coords| (n, coords)));
    let checked: Vec<Option<std::result::Result<Set, String>>> = (0..users.len())
        .into_par_iter()
        .map(|m| {
            progress.check()?;
            let found = (!users[m].is_empty()).then(|| named(m)).flatten();
            Ok(found.map(|(name, coords)| {
                let mut set = check(&scene.meshes[m], coords)?;
                let largest = users[m].iter().map(|&s| surface_area(scene, s)).fold(0.0, f64::max);
                set.metres = (largest / uv_area(&set.uvs)).sqrt();
                set.uvs.authored = Some(name.to_owned());
                Ok(set)
            }))
        })
        .collect::<Result<_>>()?;
    for (m, checked) in checked.into_iter().enumerate().filter(|(m, _)| !users[*m].is_empty()) {
        let mesh = &scene.meshes[m];
        let place = &scene.surfaces[users[m][0]].name;
        let Some((name, coords)) = named(m) else {
            if params.uv == UvMode::Keep {
                let message = format!("has no UV set {}; export one, or let new UVs be made", names.join(" or "));
                return Err(Error::invalid(place, message));
            }
            continue;
        };
        match checked.unwrap_or_else(|| Err("was not looked at".into())) {
            Ok(set) => {
                progress.advance(mesh.triangles.len() as u64);
                sets[m] = Some(set);
            }
            Err(reason) if params.uv == UvMode::Keep => {
                return Err(Error::invalid(
                    place,
                    format!("UV set {name} {reason}; mend it, or ask for --uv repack or new"),
                ));
            }
            Err(reason) => {
                let found = AuthoredUvs::measure(scene, users[m][0], name, coords, Verdict::Refused);
                let place = format!("{place} ({})", found.summary());
                let message =
                    format!("authored UV set {name} {reason}; new UVs were made, --uv repack keeps its charts");
                warnings.add(place, message);
                refused.push(AuthoredUvs { reason: Some(reason), ..found });
            }
        }
    }
    Ok((sets, refused))
}

/// All sets as page space, where every surface has one and none overlap. Takes the sets then.
pub fn page_space(
    scene: &Scene,
    sets: &mut [Option<Set>],
    params: &UnwrapParams,
    warnings: &mut Warnings,
) -> Option<Atlas> {
    let mut used = vec![false; sets.len()];
    let mut taken = Cells::new(SAMPLES);
    let (mut doubled, mut covered) = (0, 0);
    for batch in scene.surfaces.chunks(SURFACES) {
        let spans = |surface: &Surface| Some(spans(&sets[surface.mesh].as_ref()?.uvs));
        let batch: Vec<(usize, Option<Vec<Span>>)> = batch.par_iter().map(|s| (s.mesh, spans(s))).collect();
        for (mesh, own) in batch {
            // Two surfaces of a mesh have the same UVs, so they overlap.
            let own = own.filter(|_| !std::mem::replace(&mut used[mesh], true))?;
            // Counted before any is taken, so that a surface isn't held against itself.
            doubled += own.iter().map(|&[row, first, end]| taken.count(row, first, end)).sum::<usize>();
            covered += own.iter().map(|&[row, first, end]| taken.take(row, first, end)).sum::<usize>();
            if doubled as f64 > SMALL_SHARE * covered as f64 {
                return None;
            }
        }
    }
    if doubled > 0 {
        warnings.add("unwrap", "authored UVs of two surfaces overlap a little; they are used as they stand");
    }
    let meshes: Vec<MeshUvs> = sets.iter_mut().map(|s| s.take().map_or_else(MeshUvs::default, |set| set.uvs)).collect();
    let flat: f64 = scene.surfaces.iter().map(|s| uv_area(&meshes[s.mesh])).sum();
    // Texels along a page's side for each texel per metre.
    let side_per_density = (areas(scene).iter().sum::<f64>() / flat).sqrt();
    let nearest = |side: f64| (side.max(16.0).log2().round() as u32).clamp(4, 14);
    let side = match params.density {
        Density::FillPage(side) => side,
        Density::TexelsPerMetre(density) => (1 << nearest(f64::from(density) * side_per_density)).min(params.page_size),
        Density::TexelCount(count) => (1 << nearest((count as f64 / flat).sqrt())).min(params.page_size),
    };
    warn_of_shared_texels(scene, &meshes, side, warnings);
    let placement = Placement { page: 0, scale: Vec2::ONE, offset: Vec2::ZERO };
    Some(Atlas {
        pages: vec![[side; 2]],
        meshes,
        placements: vec![placement; scene.surfaces.len()],
        density: (f64::from(side) / side_per_density) as f32,
        padding: params.padding,
        shown_pages: 1,
    })
}

/// Row, first column and end of some samples.
type Span = [usize; 3];

/// The samples within the triangles of `uvs`.
fn spans(uvs: &MeshUvs) -> Vec<Span> {
    let mut spans = Vec::new();
    for t in &uvs.corners {
        centers(t.map(|p| p.as_dvec2() * SAMPLES as f64), SAMPLES, SAMPLES, |row, first, end| {
            spans.push([row, first, end]);
        });
    }
    spans
}

/// Names the surfaces with charts that touch a texel of another chart at this page size.
fn warn_of_shared_texels(scene: &Scene, meshes: &[MeshUvs], side: u32, warnings: &mut Warnings) {
    let bands: Vec<u32> = (0..side).step_by((side / BANDS).max(1) as usize).collect();
    let mixed_in = |&low: &u32| mixed(scene, meshes, side, low..(low + (side / BANDS).max(1)).min(side));
    let found: Vec<Vec<bool>> = bands.par_iter().map(mixed_in).collect();
    let is_mixed = |s: usize| found.iter().any(|mixed| mixed[s]);
    for (surface, _) in scene.surfaces.iter().zip(0..).filter(|(_, s)| is_mixed(*s)) {
        warnings.add(
            &surface.name,
            format!("authored UVs leave two charts in one texel at {side} x {side}; light can bleed between them"),
        );
    }
}

/// By surface: whether one of its charts touches a texel in `rows` of a page of `side` squared that another touched before.
fn mixed(scene: &Scene, meshes: &[MeshUvs], side: u32, rows: Range<u32>) -> Vec<bool> {
    // The chart that touched each texel first, numbered from 1 over all surfaces.
    let mut owner = vec![0u32; (rows.len() as u32 * side) as usize];
    let mut first_chart = 1;
    let of_surface = |surface: &Surface| {
        let uvs = &meshes[surface.mesh];
        let mut is_mixed = false;
        for (corners, &chart) in uvs.corners.iter().zip(&uvs.chart) {
            let corners = corners.map(|p| p.as_dvec2() * f64::from(side));
            mask::touched_rows(corners, [side; 2], &rows, |row, first, end| {
                let line = (row - rows.start) * side;
                for owner in &mut owner[(line + first) as usize..(line + end) as usize] {
                    if *owner == 0 {
                        *owner = first_chart + chart;
                    }
                    is_mixed |= *owner != first_chart + chart;
                }
            });
        }
        first_chart += uvs.chart_count;
        is_mixed
    };
    scene.surfaces.iter().map(of_surface).collect()
}

/// The set as it is, or what is wrong with it.
fn check(mesh: &Mesh, coords: &[Vec2]) -> std::result::Result<Set, String> {
    let raw = |t: &[u32; 3]| t.map(|v| coords[v as usize]);
    let corners: Vec<[Vec2; 3]> = mesh.triangles.iter().map(raw).collect();
    if corners.iter().flatten().any(|p| !p.is_finite()) {
        return Err("holds numbers that are not finite".into());
    }
    let inside = |p: &Vec2| p.min_element() >= -RANGE_TOLERANCE && p.max_element() <= 1.0 + RANGE_TOLERANCE;
    if !corners.iter().flatten().all(inside) {
        return Err("leaves 0..1".into());
    }
    let uv: Vec<[DVec2; 3]> = corners.iter().map(|t| t.map(|p| p.as_dvec2())).collect();
    let (mut none, mut total) = (0.0, 0.0);
    for (t, uv) in mesh.triangles.iter().zip(&uv) {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize].as_dvec3());
        let area = 0.5 * (b - a).cross(c - a).length();
        let flat = super::chart::signed_area(*uv);
        total += area;
        // Mirrored charts are as good as others here; only those without area hold no light.
        none += if flat.abs() < 1e-12 { area } else { 0.0 };
    }
    if none > SMALL_SHARE * total {
        return Err(format!("has no area in {:.1} % of the mesh", 100.0 * none / total));
    }
    let (mut taken, mut doubled, mut covered) = (Cells::new(SAMPLES), 0, 0);
    for t in &uv {
        centers(t.map(|p| p * SAMPLES as f64), SAMPLES, SAMPLES, |row, first, end| {
            doubled += end - first - taken.take(row, first, end);
            covered += end - first;
        });
    }
    if doubled as f64 > SMALL_SHARE * covered as f64 {
        return Err(format!("overlaps itself in {:.1} % of its area", 100.0 * doubled as f64 / covered as f64));
    }
    let (low, high) = bounds(&uv);
    let chart = charts(mesh, coords);
    let chart_count = chart.iter().max().map_or(0, |m| m + 1);
    Ok(Set { uvs: MeshUvs { corners, chart, chart_count, authored: None }, low, high, metres: 1.0 })
}

/// The chart of each triangle: connected in UVs by an edge, with one material.
pub fn charts(mesh: &Mesh, coords: &[Vec2]) -> Vec<u32> {
    let all: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
    let place = weld(mesh, coords);
    let mut edges = Vec::with_capacity(3 * all.len());
    for (i, (t, material)) in mesh.triangles.iter().zip(&mesh.triangle_material).enumerate() {
        let v = t.map(|v| place[v as usize]);
        let edge = |a: u32, b: u32| (a.min(b), a.max(b), *material, i as u32);
        edges.extend([edge(v[0], v[1]), edge(v[1], v[2]), edge(v[2], v[0])]);
    }
    edges.sort_unstable();
    let mut sets = Sets::new(all.len());
    for shared in edges.chunk_by(|a, b| (a.0, a.1, a.2) == (b.0, b.1, b.2)) {
        shared.iter().for_each(|edge| sets.join(shared[0].3, edge.3));
    }
    let mut chart = vec![0; all.len()];
    for (c, group) in sets.groups(&all).into_iter().enumerate() {
        group.into_iter().for_each(|t| chart[t as usize] = c as u32);
    }
    chart
}

/// A number for each vertex, equal for those at one place with one UV.
fn weld(mesh: &Mesh, coords: &[Vec2]) -> Vec<u32> {
    // Adding zero makes -0 and 0 one.
    let key = |v: usize| {
        let ([x, y, z], [s, t]) = ((mesh.positions[v] + 0.0).to_array(), (coords[v] + 0.0).to_array());
        [x, y, z, s, t].map(f32::to_bits)
    };
    let mut order: Vec<([u32; 5], u32)> = (0..mesh.positions.len()).map(|v| (key(v), v as u32)).collect();
    order.sort_unstable();
    let mut place = vec![0; order.len()];
    for same in order.chunk_by(|a, b| a.0 == b.0) {
        same.iter().for_each(|(_, v)| place[*v as usize] = same[0].1);
    }
    place
}

/// Area of a mesh's UVs, of either sign.
fn uv_area(uvs: &MeshUvs) -> f64 {
    uvs.corners.iter().map(|t| super::chart::signed_area(t.map(|p| p.as_dvec2())).abs()).sum()
}
