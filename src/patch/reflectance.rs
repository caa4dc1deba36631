//! Albedo and emission of each patch, averaged over its footprint in linear light.
//!
//! Apart from [`Patches`](super::Patches): relighting changes these and keeps the geometry.

use super::palette::{Builder, Palette};
use super::{Ground, footprint::Piece, stop::LEAST_STOP};
use crate::Result;
use crate::color::Rgb;
use crate::progress::Progress;
use crate::scene::look::bounded;
pub use crate::scene::look::{MOST_ALBEDO, albedo_at, emission_at, passing_at};
use crate::scene::material::mean_share;
use crate::scene::{Material, Mesh, Scene, TextureSlot};
use glam::Vec2;
use rayon::prelude::*;

/// Diffuse albedo of each patch, 0..=[`MOST_ALBEDO`]: of the light that it stops, what it sends back. Where a patch lets one channel
/// through more than another, more than [`MOST_ALBEDO`] of the mean may come back in the others.
#[derive(Clone, Debug)]
pub struct Reflectance(pub Palette);

/// Radiance that each patch emits from its front [nit], as far as it stops light; M = pi L.
#[derive(Clone, Debug)]
pub struct Emission(pub Palette);

/// Texture look-ups along one side of a piece, at most: 16 x 16 of them average a footprint of any size well enough.
const MOST_SAMPLES_A_SIDE: u32 = 16;

/// Patches whose materials are looked up before they are stored.
const BATCH: usize = 1 << 16;

/// Averages the materials over all footprints, as sources of light: surfaces that don't cast are black.
///
/// # Errors
/// `Cancelled`.
pub fn reflectance(ground: &Ground, progress: &dyn Progress) -> Result<(Reflectance, Emission)> {
    averages(ground, |i| ground.casts(i), progress)
}

/// Averages the materials over all footprints, as they look.
///
/// # Errors
/// `Cancelled`.
pub fn shown_reflectance(ground: &Ground, progress: &dyn Progress) -> Result<(Reflectance, Emission)> {
    averages(ground, |_| true, progress)
}

fn averages(
    ground: &Ground,
    counts: impl Fn(usize) -> bool + Sync,
    progress: &dyn Progress,
) -> Result<(Reflectance, Emission)> {
    let of = |i: usize| if counts(i) { average(ground, i) } else { (Rgb::ZERO, Rgb::ZERO) };
    let count = ground.patches.len();
    let (mut albedo, mut emission) = (Builder::default(), Builder::default());
    for first in (0..count).step_by(BATCH) {
        progress.check()?;
        let batch = (first..count.min(first + BATCH)).into_par_iter();
        let found: (Vec<Rgb>, Vec<Rgb>) = batch.with_min_len(1024).map(of).unzip();
        albedo.extend(found.0);
        emission.extend(found.1);
    }
    Ok((Reflectance(albedo.finish()), Emission(emission.finish())))
}

fn average(ground: &Ground, i: usize) -> (Rgb, Rgb) {
    let scene = ground.scene;
    let material_of = |number: u32| {
        let (surface, triangle) = ground.tracer.place(number);
        let mesh = &scene.meshes[scene.surfaces[surface].mesh];
        (mesh, mesh.triangle_material[triangle])
    };
    // Most patches lie in one plain material.
    let (mesh, index) = material_of(ground.patches.first_triangle(i));
    let material = &scene.materials[index as usize];
    if is_plain(mesh, material) && ground.patches.pieces(i).all(|(triangle, _)| material_of(triangle).1 == index) {
        return (bounded(material.albedo), material.emission);
    }
    let footprint = ground.footprint(i);
    let (mut albedo, mut emission, mut stopped, mut area) = (Rgb::ZERO, Rgb::ZERO, 0.0, 0.0);
    for piece in &footprint.pieces {
        let (a, e, stop) = average_piece(scene, piece);
        albedo += a * piece.area;
        emission += e * piece.area;
        stopped += stop * piece.area;
        area += piece.area;
    }
    let by = stopped.max(area * LEAST_STOP);
    if by > 0.0 { (albedo / by, emission / by) } else { (Rgb::ZERO, Rgb::ZERO) }
}

fn is_plain(mesh: &Mesh, material: &Material) -> bool {
    mesh.colors.is_empty() && material.slots().next().is_none() && !material.lets_light_through()
}

/// Means over a piece: what it sends back of the light that meets it, what it emits, and what it stops.
fn average_piece(scene: &Scene, piece: &Piece) -> (Rgb, Rgb, f32) {
    let (surface, triangle) = (piece.facet.surface, piece.facet.triangle);
    let mesh = &scene.meshes[scene.surfaces[surface].mesh];
    let (mut albedo, mut emission, mut stopped, mut n) = (Rgb::ZERO, Rgb::ZERO, 0.0, 0.0f32);
    grid(scene, piece, |at| {
        let (opacity, passes) = passing_at(scene, mesh, triangle, at);
        albedo += albedo_at(scene, mesh, triangle, at) * opacity;
        emission += emission_at(scene, mesh, triangle, at);
        stopped += 1.0 - mean_share(passes);
        n += 1.0;
    });
    (albedo / n, emission / n, stopped / n)
}

/// Calls `visit` with the corner weights of points all over a piece, as dense as the textures of its material ask for.
pub(super) fn grid(scene: &Scene, piece: &Piece, mut visit: impl FnMut(Vec2)) {
    let (surface, triangle) = (piece.facet.surface, piece.facet.triangle);
    let mesh = &scene.meshes[scene.surfaces[surface].mesh];
    let slots = scene.material(surface, triangle).slots();
    let side = slots.map(|slot| samples_a_side(scene, mesh, triangle, slot, piece)).max().unwrap_or(2);
    for y in 0..side {
        for x in 0..side {
            let u = [(x as f32 + 0.5) / side as f32, (y as f32 + 0.5) / side as f32];
            visit(piece.sample(u));
        }
    }
}

/// So many that there is about one look-up for each texel of the picture under the piece.
fn samples_a_side(scene: &Scene, mesh: &Mesh, triangle: usize, slot: &TextureSlot, piece: &Piece) -> u32 {
    let texture = &scene.textures[slot.texture];
    let Some(uv) = mesh.uv_set(&slot.uv_set) else { return 1 };
    let [a, b, c] = mesh.triangles[triangle].map(|v| slot.image_from_uv.transform_point2(uv[v as usize]));
    let size = Vec2::new(texture.width as f32, texture.height as f32);
    let whole = ((b - a) * size).perp_dot((c - a) * size).abs() * 0.5;
    let pixels = whole * piece.share();
    (pixels.sqrt().ceil() as u32).clamp(2, MOST_SAMPLES_A_SIDE)
}

/// The materials of `scene` that are whiter than [`MOST_ALBEDO`] where no texture darkens them.
pub fn too_white(scene: &Scene) -> impl Iterator<Item = &Material> {
    let used: std::collections::BTreeSet<u32> =
        scene.surfaces.iter().flat_map(|s| scene.meshes[s.mesh].triangle_material.iter().copied()).collect();
    let materials = used.into_iter().map(|m| &scene.materials[m as usize]);
    materials.filter(|m| m.albedo_texture.is_none() && m.albedo.max_element() > MOST_ALBEDO)
}
