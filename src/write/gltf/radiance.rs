//! What an unlit viewer has to show at the corners of triangles.
//!
//! A viewer multiplies the vertex colour with the base colour, so where a surface only reflects it is E / pi (times the
//! vertex colour that the source has). Where a triangle shines itself no factor on the base colour will do (it may be
//! black): there it is all that leaves the surface, albedo * E / pi + L_e, and the writer gives those triangles a white
//! material.

use crate::color::{Rgb, luminance};
use crate::meshing::LitTriangle;
use crate::post::Quantity;
use crate::scene::{Mesh, Scene, TextureSlot};
use crate::write::Baked;
use crate::write::blend::Blend;
use crate::write::pieces::Pieces;
use glam::{DVec3, Vec2, Vec4};
use std::f32::consts::PI;

/// Vertex colour and alpha, then the lightmap's own quantity.
pub type CornerValue = [f32; 7];

/// The light on one surface.
pub struct SurfaceLight<'a> {
    /// The pieces of its mesh's triangles.
    pub triangles: &'a [LitTriangle],
    /// By piece: the values at its corners. Colours are divided by the scale, in 0..=1.
    pub corners: Vec<[CornerValue; 3]>,
    /// By piece: true where the colour is all that leaves the surface, not a factor on the base colour.
    pub whole: Vec<bool>,
}

impl SurfaceLight<'_> {
    /// The pieces with their values.
    pub fn pieces(&self) -> Pieces<'_, 7> {
        Pieces::cut(self.triangles, &self.corners)
    }
}

/// Share of the outgoing light that has to be a triangle's own for it to count as shining: less is the noise of a
/// compressed emission texture.
const EMISSION_SHARE: f32 = 0.01;

/// The light on every surface, and the scale [nit] that takes vertex colours back to outgoing radiance: the largest value
/// of any surface that doesn't shine itself. Lamps are brighter, and would leave the room black; they are clipped to the
/// brightest colour of their hue.
pub fn surface_lights<'a>(baked: &Baked<'a>) -> (Vec<SurfaceLight<'a>>, f32) {
    let surfaces = (0..baked.scene.surfaces.len()).map(|s| surface_light(baked, s)).collect::<Vec<_>>();
    let peak = |shining: bool| {
        let pieces = surfaces.iter().flat_map(|(light, emits)| light.corners.iter().zip(emits));
        let corners = pieces.filter(|(_, emits)| shining || !**emits).flat_map(|(corners, _)| corners);
        corners.flat_map(|c| c[..3].iter().copied()).filter(|v| v.is_finite()).fold(0.0, f32::max)
    };
    let scale = [peak(false), peak(true), 1.0].into_iter().find(|s| *s > 0.0).unwrap_or(1.0);
    let mut lights: Vec<SurfaceLight> = surfaces.into_iter().map(|(light, _)| light).collect();
    for corner in lights.iter_mut().flat_map(|l| &mut l.corners).flatten() {
        let color = Rgb::from_slice(corner) / scale;
        let color = if color.is_finite() { color.max(Rgb::ZERO) / color.max_element().max(1.0) } else { Rgb::ZERO };
        // The division may round to just above 1, which the format forbids.
        corner[..3].copy_from_slice(&color.min(Rgb::ONE).to_array());
    }
    (lights, scale)
}

/// The light on a surface with unscaled colours [nit], and which of its pieces shine.
fn surface_light<'a>(baked: &Baked<'a>, surface: usize) -> (SurfaceLight<'a>, Vec<bool>) {
    let scene = baked.scene;
    let mesh = &scene.meshes[scene.surfaces[surface].mesh];
    let quantity = baked.quantity;
    let triangles: &[LitTriangle] = baked.vertices.map_or(&[], |v| &v.surfaces[surface].triangles);
    let mut light = SurfaceLight { triangles, corners: Vec::new(), whole: Vec::new() };
    let mut emits = Vec::new();
    for lit in triangles {
        let (t, values) = (lit.source as usize, lit.values);
        let positions = mesh.triangles[t].map(|v| mesh.positions[v as usize]);
        let blends = lit.corners.map(|place| Blend::at(place, mesh.triangles[t], positions));
        let material = &scene.materials[mesh.triangle_material[t] as usize];
        // At a corner, and at a point inside that the corners weigh.
        let at = |slot: &Option<TextureSlot>, k: usize| {
            texture_value(scene, mesh, slot.as_ref(), |coords| blends[k].coords(coords))
        };
        let inside = |slot: &Option<TextureSlot>, place: [f32; 3]| {
            texture_value(scene, mesh, slot.as_ref(), |coords| {
                mesh.triangles[t].iter().zip(place).map(|(v, w)| coords[*v as usize] * w).sum()
            })
        };
        let vertex_color = |k: usize| if mesh.colors.is_empty() { Vec4::ONE } else { blends[k].color(&mesh.colors) };
        let emission = |k: usize| material.emission * at(&material.emission_texture, k);
        let albedo = |k: usize| material.albedo * at(&material.albedo_texture, k) * vertex_color(k).truncate();
        // E / pi at a corner, where the lightmap holds light that arrives.
        let incoming = |k: usize| if quantity == Quantity::Irradiance { values[k] / PI } else { values[k] };
        let shining = |w: &[f32; 3]| luminance(material.emission * inside(&material.emission_texture, within(lit, *w)));
        let own = INSIDE.iter().map(shining).fold(0.0, f32::max);
        let reflected =
            |k: usize| if quantity == Quantity::Radiosity { values[k] / PI } else { albedo(k) * incoming(k) };
        let shines = material.is_emissive()
            && own > EMISSION_SHARE * (own + (0..3).map(|k| luminance(reflected(k))).fold(0.0, f32::max));
        let whole = shines || quantity == Quantity::Radiosity;
        light.corners.push([0, 1, 2].map(|k| {
            let color = match quantity {
                // Emission is in B already.
                Quantity::Radiosity => values[k] / PI,
                _ if whole => reflected(k) + emission(k),
                _ => incoming(k) * vertex_color(k).truncate(),
            };
            let (alpha, v) = (vertex_color(k).w.clamp(0.0, 1.0), values[k]);
            [color.x, color.y, color.z, alpha, v.x, v.y, v.z]
        }));
        light.whole.push(whole);
        emits.push(shines);
    }
    (light, emits)
}

/// Barycentric weights of points spread over a triangle.
const INSIDE: [[f32; 3]; 7] = [
    [0.9, 0.05, 0.05],
    [0.05, 0.9, 0.05],
    [0.05, 0.05, 0.9],
    [0.475, 0.475, 0.05],
    [0.05, 0.475, 0.475],
    [0.475, 0.05, 0.475],
    [1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0],
];

/// The place in the source's triangle of the point of a piece that its corners weigh by `weights`.
fn within(piece: &LitTriangle, weights: [f32; 3]) -> [f32; 3] {
    let place: DVec3 = piece.corners.iter().zip(weights).map(|(corner, w)| corner.0 * f64::from(w)).sum();
    place.as_vec3().to_array()
}

/// A texture's colour at the UVs that `uv` finds in its set; white where there is no texture.
fn texture_value(scene: &Scene, mesh: &Mesh, slot: Option<&TextureSlot>, uv: impl Fn(&[Vec2]) -> Vec2) -> Rgb {
    let Some(slot) = slot else { return Rgb::ONE };
    let Some(coords) = mesh.uv_set(&slot.uv_set) else { return Rgb::ONE };
    let texel = scene.textures[slot.texture].sample(slot.image_from_uv.transform_point2(uv(coords)), slot.wrap);
    (texel * slot.scale + slot.bias).truncate()
}
