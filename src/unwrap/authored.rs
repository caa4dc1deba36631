//! Lightmap UVs that the scene brings along.
//!
//! A set is sound when its UVs are finite, lie in 0..1, have area, and don't overlap. Where all surfaces have sound sets that
//! don't overlap each other either, the UVs are page coordinates as they stand; else each surface gets a rectangle for its set.

use super::layout::Content;
use super::mask;
use super::overlap::{bounds, centers};
use super::shape::Sets;
use super::{Atlas, Density, MeshUvs, Placement, UnwrapParams, UvMode, area};
use crate::error::{Error, Result, Warnings};
use crate::progress::Progress;
use crate::scene::{Mesh, Scene};
use glam::{DVec2, Vec2};
use std::collections::HashMap;

/// How far [UV] a coordinate may leave 0..1: rounding in exporters.
const RANGE_TOLERANCE: f32 = 1e-4;
/// Share of a mesh's area that may have UVs without area. The texels of such triangles are worthless, but
/// a few slivers are no reason to throw an artist's work away.
const SMALL_SHARE: f64 = 1e-3;
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

/// The sound authored set of each mesh that has one, by mesh.
///
/// # Errors
/// `Invalid` under [`UvMode::Keep`], naming the first surface without a sound set and what is wrong; `Cancelled`.
pub fn sets(
    scene: &Scene,
    users: &[Vec<usize>],
    params: &UnwrapParams,
    warnings: &mut Warnings,
    progress: &dyn Progress,
) -> Result<Vec<Option<Set>>> {
    let mut sets = vec![None; users.len()];
    if params.uv == UvMode::New {
        return Ok(sets);
    }
    let named: Vec<&str> = params.uv_name.as_deref().map_or(vec!["TEXCOORD_1", "st1"], |n| vec![n]);
    for (m, surfaces) in users.iter().enumerate().filter(|(_, s)| !s.is_empty()) {
        progress.check()?;
        let mesh = &scene.meshes[m];
        let place = &scene.surfaces[surfaces[0]].name;
        let found = named.iter().find_map(|&n| mesh.uv_set(n).map(|coords| (n, coords)));
        let Some((name, coords)) = found else {
            if params.uv == UvMode::Keep {
                let message = format!("has no UV set {}; export one, or let new UVs be made", named.join(" or "));
                return Err(Error::invalid(place, message));
            }
            continue;
        };
        match check(mesh, coords) {
            Ok(mut set) => {
                let area = |s: usize| -> f64 {
                    let corners = (0..mesh.triangles.len()).map(|t| scene.world_triangle(s, t).map(|p| p.as_dvec3()));
                    corners.map(|[a, b, c]| 0.5 * (b - a).cross(c - a).length()).sum()
                };
                let largest = surfaces.iter().map(|&s| area(s)).fold(0.0, f64::max);
                set.metres = (largest / uv_area(&set.uvs)).sqrt();
                set.uvs.authored = Some(name.to_owned());
                progress.advance(mesh.triangles.len() as u64);
                sets[m] = Some(set);
            }
            Err(reason) if params.uv == UvMode::Keep => {
                return Err(Error::invalid(place, format!("UV set {name} {reason}; mend it, or let new UVs be made")));
            }
            Err(reason) => warnings.add(place, format!("authored UV set {name} {reason}; new UVs were made")),
        }
    }
    Ok(sets)
}

/// All sets as page space, where every surface has one and none overlap. Takes the sets then.
pub fn page_space(
    scene: &Scene,
    sets: &mut [Option<Set>],
    params: &UnwrapParams,
    warnings: &mut Warnings,
) -> Option<Atlas> {
    let mut used = vec![false; sets.len()];
    let mut taken = vec![false; SAMPLES * SAMPLES];
    let (mut doubled, mut covered) = (0usize, 0usize);
    for surface in &scene.surfaces {
        // Two surfaces of a mesh have the same UVs, so they overlap.
        let set = sets[surface.mesh].as_ref().filter(|_| !std::mem::replace(&mut used[surface.mesh], true))?;
        let mut own = Vec::new();
        for t in &set.uvs.corners {
            centers(t.map(|p| p.as_dvec2() * SAMPLES as f64), SAMPLES, SAMPLES, |row, first, end| {
                own.push(row * SAMPLES + first..row * SAMPLES + end);
            });
        }
        // Checked before any is taken, so that a surface isn't held against itself.
        doubled += own.iter().cloned().flatten().filter(|&c| taken[c]).count();
        for cell in own.into_iter().flatten() {
            covered += usize::from(!std::mem::replace(&mut taken[cell], true));
        }
        if doubled as f64 > SMALL_SHARE * covered as f64 {
            return None;
        }
    }
    if doubled > 0 {
        warnings.add("unwrap", "authored UVs of two surfaces overlap a little; they are used as they stand");
    }
    let meshes: Vec<MeshUvs> = sets.iter_mut().map(|s| s.take().map_or_else(MeshUvs::default, |set| set.uvs)).collect();
    let flat: f64 = scene.surfaces.iter().map(|s| uv_area(&meshes[s.mesh])).sum();
    // Texels along a page's side for each texel per metre.
    let side_per_density = (area(scene) / flat).sqrt();
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
    })
}

/// Names the surfaces with charts that touch a texel of another chart at this page size.
fn warn_of_shared_texels(scene: &Scene, meshes: &[MeshUvs], side: u32, warnings: &mut Warnings) {
    let mut owner: HashMap<(u32, u32), (usize, u32)> = HashMap::new();
    let mut mixed = vec![false; scene.surfaces.len()];
    for (s, surface) in scene.surfaces.iter().enumerate() {
        let uvs = &meshes[surface.mesh];
        for (corners, &chart) in uvs.corners.iter().zip(&uvs.chart) {
            mask::touched(corners.map(|p| p.as_dvec2() * f64::from(side)), [side; 2], |row, first, end| {
                for x in first..end {
                    mixed[s] |= *owner.entry((row, x)).or_insert((s, chart)) != (s, chart);
                }
            });
        }
    }
    for (surface, _) in scene.surfaces.iter().zip(mixed).filter(|(_, mixed)| *mixed) {
        warnings.add(
            &surface.name,
            format!("authored UVs leave two charts in one texel at {side} x {side}; light can bleed between them"),
        );
    }
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
    let (mut taken, mut doubled, mut covered) = (vec![0u64; SAMPLES * SAMPLES / 64], 0usize, 0usize);
    for t in &uv {
        centers(t.map(|p| p * SAMPLES as f64), SAMPLES, SAMPLES, |row, first, end| {
            for cell in (row * SAMPLES + first)..(row * SAMPLES + end) {
                let bit = 1 << (cell % 64);
                doubled += usize::from(taken[cell / 64] & bit != 0);
                taken[cell / 64] |= bit;
                covered += 1;
            }
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
fn charts(mesh: &Mesh, coords: &[Vec2]) -> Vec<u32> {
    let all: Vec<u32> = (0..mesh.triangles.len() as u32).collect();
    let mut sets = Sets::new(all.len());
    let mut edges = HashMap::new();
    let key = |v: u32| (mesh.positions[v as usize] + 0.0).to_array().map(f32::to_bits);
    let uv_key = |v: u32| (coords[v as usize] + 0.0).to_array().map(f32::to_bits);
    for (i, t) in mesh.triangles.iter().enumerate() {
        let v = t.map(|v| (key(v), uv_key(v)));
        for (a, b) in [(v[0], v[1]), (v[1], v[2]), (v[2], v[0])] {
            let edge = (a.min(b), a.max(b), mesh.triangle_material[i]);
            let first = *edges.entry(edge).or_insert(i as u32);
            sets.join(first, i as u32);
        }
    }
    let mut chart = vec![0; all.len()];
    for (c, group) in sets.groups(&all).into_iter().enumerate() {
        group.into_iter().for_each(|t| chart[t as usize] = c as u32);
    }
    chart
}

/// Area of a mesh's UVs, of either sign.
fn uv_area(uvs: &MeshUvs) -> f64 {
    uvs.corners.iter().map(|t| super::chart::signed_area(t.map(|p| p.as_dvec2())).abs()).sum()
}
