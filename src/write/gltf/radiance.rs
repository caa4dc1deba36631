//! What an unlit viewer has to show at the corners of triangles.
//!
//! A viewer multiplies the vertex colour with the base colour, so where a surface only reflects it is E / pi (times the
//! vertex colour that the source has). Where a triangle shines itself no factor on the base colour will do (it may be
//! black): there it is all that leaves the surface, albedo * E / pi + L_e, and the writer gives those triangles a white
//! material.

use crate::color::{Rgb, luminance};
use crate::post::Quantity;
use crate::scene::{Mesh, Scene, TextureSlot};
use crate::write::Baked;
use glam::Vec2;
use std::f32::consts::PI;

/// Vertex colour and alpha, then the lightmap's own quantity.
pub type CornerValue = [f32; 7];

/// The light on one surface.
pub struct SurfaceLight {
    /// By triangle of its mesh: the values at its corners. Colours are divided by the scale, in 0..=1.
    pub corners: Vec<[CornerValue; 3]>,
    /// By triangle: true where the colour is all that leaves the surface, not a factor on the base colour.
    pub whole: Vec<bool>,
}

/// Share of the outgoing light that has to be a triangle's own for it to count as shining: less is the noise of a
/// compressed emission texture.
const EMISSION_SHARE: f32 = 0.01;

/// The light on every surface, and the scale [nit] that takes vertex colours back to outgoing radiance: the largest value
/// of any surface that doesn't shine itself. Lamps are brighter, and would leave the room black; they are clipped to the
/// brightest colour of their hue.
pub fn surface_lights(baked: &Baked) -> (Vec<SurfaceLight>, f32) {
    let surfaces = (0..baked.scene.surfaces.len()).map(|s| surface_light(baked, s)).collect::<Vec<_>>();
    let peak = |shining: bool| {
        let triangles = surfaces.iter().flat_map(|(light, emits)| light.corners.iter().zip(emits));
        let corners = triangles.filter(|(_, emits)| shining || !**emits).flat_map(|(corners, _)| corners);
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

/// The light on a surface with unscaled colours [nit], and which of its triangles shine.
fn surface_light(baked: &Baked, surface: usize) -> (SurfaceLight, Vec<bool>) {
    let scene = baked.scene;
    let mesh = &scene.meshes[scene.surfaces[surface].mesh];
    let quantity = baked.quantity;
    let mut light = SurfaceLight { corners: Vec::new(), whole: Vec::new() };
    let mut emits = Vec::new();
    for piece in baked.vertices.iter().flat_map(|v| &v.surfaces[surface].triangles) {
        let (t, values) = (piece.source as usize, piece.values);
        let material = &scene.materials[mesh.triangle_material[t] as usize];
        let at = |slot: &Option<TextureSlot>, weights: [f32; 3]| texture_value(scene, mesh, t, slot.as_ref(), weights);
        let vertex_color =
            |k: usize| mesh.colors.get(mesh.triangles[t][k] as usize).copied().unwrap_or(glam::Vec4::ONE);
        let emission = |weights| material.emission * at(&material.emission_texture, weights);
        let albedo = |k: usize| material.albedo * at(&material.albedo_texture, CORNERS[k]) * vertex_color(k).truncate();
        // E / pi at a corner, where the lightmap holds light that arrives.
        let incoming = |k: usize| if quantity == Quantity::Irradiance { values[k] / PI } else { values[k] };
        let own = INSIDE.iter().map(|w| luminance(emission(*w))).fold(0.0, f32::max);
        let reflected =
            |k: usize| if quantity == Quantity::Radiosity { values[k] / PI } else { albedo(k) * incoming(k) };
        let shines = material.is_emissive()
            && own > EMISSION_SHARE * (own + (0..3).map(|k| luminance(reflected(k))).fold(0.0, f32::max));
        let whole = shines || quantity == Quantity::Radiosity;
        light.corners.push([0, 1, 2].map(|k| {
            let color = match quantity {
                // Emission is in B already.
                Quantity::Radiosity => values[k] / PI,
                _ if whole => reflected(k) + emission(CORNERS[k]),
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

/// Barycentric weights of the corners, and of points spread over a triangle.
const CORNERS: [[f32; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
const INSIDE: [[f32; 3]; 7] = [
    [0.9, 0.05, 0.05],
    [0.05, 0.9, 0.05],
    [0.05, 0.05, 0.9],
    [0.475, 0.475, 0.05],
    [0.05, 0.475, 0.475],
    [0.475, 0.05, 0.475],
    [1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0],
];

/// A texture's colour at a point of a triangle; white where there is no texture.
fn texture_value(scene: &Scene, mesh: &Mesh, triangle: usize, slot: Option<&TextureSlot>, weights: [f32; 3]) -> Rgb {
    let Some(slot) = slot else { return Rgb::ONE };
    let Some(coords) = mesh.uv_set(&slot.uv_set) else { return Rgb::ONE };
    let uv: Vec2 = mesh.triangles[triangle].iter().zip(weights).map(|(v, w)| coords[*v as usize] * w).sum();
    let texel = scene.textures[slot.texture].sample(slot.image_from_uv.transform_point2(uv), slot.wrap);
    (texel * slot.scale + slot.bias).truncate()
}
