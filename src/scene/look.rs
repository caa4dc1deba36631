//! What a material is at a point of a triangle: factors, textures (bilinear) and vertex colours together.
//!
//! A point is given by the weights of the triangle's corners 1 and 2, in the order of the mesh.

use super::material::passing;
use super::{Alpha, Mesh, Scene, TextureSlot};
use crate::color::Rgb;
use glam::{Vec2, Vec4};

/// The highest albedo that is baked. Between surfaces that absorb nothing light never dies out; fresh snow and the
/// whitest paints reach this, and glTF's default material, which says 1, means nothing of the kind.
pub const MOST_ALBEDO: f32 = 0.97;

/// Linear RGBA of a texture slot at weights `at` of a triangle; white where the mesh lacks its UVs.
pub fn look_up(scene: &Scene, mesh: &Mesh, triangle: usize, slot: &TextureSlot, at: Vec2) -> Vec4 {
    let Some(uv) = mesh.uv_set(&slot.uv_set) else { return Vec4::ONE };
    let [a, b, c] = mesh.triangles[triangle].map(|v| uv[v as usize]);
    let uv = slot.image_from_uv.transform_point2(a + (b - a) * at.x + (c - a) * at.y);
    scene.textures[slot.texture].sample(uv, slot.wrap) * slot.scale + slot.bias
}

/// Diffuse albedo at a point of a triangle, 0..=[`MOST_ALBEDO`].
pub fn albedo_at(scene: &Scene, mesh: &Mesh, triangle: usize, at: Vec2) -> Rgb {
    let material = &scene.materials[mesh.triangle_material[triangle] as usize];
    let mut albedo = material.albedo;
    if let Some(slot) = &material.albedo_texture {
        albedo *= look_up(scene, mesh, triangle, slot, at).truncate();
    }
    if !mesh.colors.is_empty() {
        albedo *= vertex_color(mesh, triangle, at);
    }
    bounded(albedo)
}

/// The vertex colour at a point of a triangle; white where the mesh has none.
pub fn vertex_color(mesh: &Mesh, triangle: usize, at: Vec2) -> Rgb {
    if mesh.colors.is_empty() {
        return Rgb::ONE;
    }
    let [a, b, c] = mesh.triangles[triangle].map(|v| mesh.colors[v as usize].truncate());
    a * (1.0 - at.x - at.y) + b * at.x + c * at.y
}

/// `albedo` within 0..=[`MOST_ALBEDO`].
pub fn bounded(albedo: Rgb) -> Rgb {
    albedo.clamp(Rgb::ZERO, Rgb::splat(MOST_ALBEDO))
}

/// Opacity at a point of a triangle, 0..=1, and the share of light, by channel, that passes there.
pub fn passing_at(scene: &Scene, mesh: &Mesh, triangle: usize, at: Vec2) -> (f32, Rgb) {
    let material = &scene.materials[mesh.triangle_material[triangle] as usize];
    if !material.lets_light_through() {
        return (1.0, Rgb::ZERO);
    }
    let opacity = opacity_at(scene, mesh, triangle, at);
    let tint = material.transmission_texture.as_ref();
    let tint = tint.map_or(Rgb::ONE, |slot| look_up(scene, mesh, triangle, slot, at).truncate());
    (opacity, passing(opacity, material.transmission * tint))
}

fn opacity_at(scene: &Scene, mesh: &Mesh, triangle: usize, at: Vec2) -> f32 {
    let material = &scene.materials[mesh.triangle_material[triangle] as usize];
    if material.alpha == Alpha::Opaque {
        return 1.0;
    }
    let mut alpha = material.opacity_slot().map_or(1.0, |slot| look_up(scene, mesh, triangle, slot, at).w);
    if !mesh.colors.is_empty() {
        let [a, b, c] = mesh.triangles[triangle].map(|v| mesh.colors[v as usize].w);
        alpha *= a * (1.0 - at.x - at.y) + b * at.x + c * at.y;
    }
    material.alpha.share(alpha)
}

/// Emitted radiance at a point of a triangle [nit], as far as it is opaque.
pub fn emission_at(scene: &Scene, mesh: &Mesh, triangle: usize, at: Vec2) -> Rgb {
    let material = &scene.materials[mesh.triangle_material[triangle] as usize];
    let emission = match &material.emission_texture {
        Some(slot) => (material.emission * look_up(scene, mesh, triangle, slot, at).truncate()).max(Rgb::ZERO),
        None => material.emission,
    };
    emission * opacity_at(scene, mesh, triangle, at)
}
