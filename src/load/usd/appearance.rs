//! Looks beyond the diffuse: what surface shaders say of mirrors, coats and, as far as it is clear what is meant,
//! glass, read where [`crate::load::LoadOptions::appearance`] asks for it.
//!
//! | surface | metal | roughness | dielectric | coat | clear |
//! |---|---|---|---|---|---|
//! | UsdPreviewSurface | metallic | roughness | ior; specularColor with useSpecularWorkflow | clearcoat, clearcoatRoughness | |
//! | standard_surface | metalness | specular_roughness | specular_IOR, specular, specular_color | coat, coat_roughness | transmission, as a thin sheet |
//! | open_pbr_surface | base_metalness | specular_roughness | specular_ior, specular_weight, specular_color | coat_weight, coat_roughness | transmission_weight, as a thin sheet |
//! | gltf_pbr | metallic | roughness | ior, specular, specular_color | clearcoat, clearcoat_roughness | transmission; a solid where thickness > 0 |
//!
//! A measured reflection goes before all of these: `float[] lumel:lobes` on the Material prim, the diffuse albedo
//! (three numbers) and, for each lobe, x, y, z and exponent (three numbers each), see [`Lobes`].

use super::material::Materials;
use super::network;
use super::read::{self, Reading};
use crate::color::Rgb;
use crate::scene::{Appearance, Channel, ChannelSlot, Dielectric, Lobe, Lobes, TextureSlot, Walls};
use openusd::usd::Prim;

/// Names of a shader's inputs, and what they are unless authored.
struct Inputs {
    metallic: (&'static str, f32),
    roughness: (&'static str, f32),
    ior: &'static str,
    /// Weight and colour of the dielectric's mirror.
    specular: Option<(&'static str, &'static str)>,
    clearcoat: &'static str,
    clearcoat_roughness: (&'static str, f32),
    transmission: Option<&'static str>,
}

/// The inputs of the shader `id`, which [`super::material`] knows.
fn inputs(id: &str) -> Inputs {
    let standard = Inputs {
        metallic: ("metalness", 0.0),
        roughness: ("specular_roughness", 0.2),
        ior: "specular_IOR",
        specular: Some(("specular", "specular_color")),
        clearcoat: "coat",
        clearcoat_roughness: ("coat_roughness", 0.1),
        transmission: Some("transmission"),
    };
    match id {
        "ND_open_pbr_surface_surfaceshader" => Inputs {
            metallic: ("base_metalness", 0.0),
            roughness: ("specular_roughness", 0.3),
            ior: "specular_ior",
            specular: Some(("specular_weight", "specular_color")),
            clearcoat: "coat_weight",
            clearcoat_roughness: ("coat_roughness", 0.0),
            transmission: Some("transmission_weight"),
        },
        "ND_gltf_pbr_surfaceshader" => Inputs {
            metallic: ("metallic", 1.0),
            roughness: ("roughness", 1.0),
            ior: "ior",
            clearcoat: "clearcoat",
            clearcoat_roughness: ("clearcoat_roughness", 0.0),
            ..standard
        },
        "UsdPreviewSurface" | "ND_UsdPreviewSurface_surfaceshader" => Inputs {
            metallic: ("metallic", 0.0),
            roughness: ("roughness", 0.5),
            ior: "ior",
            specular: None,
            clearcoat: "clearcoat",
            clearcoat_roughness: ("clearcoatRoughness", 0.01),
            transmission: None,
        },
        _ => standard,
    }
}

/// The look of the material `prim` with the surface `shader` of the kind `id`, whose base colour is `base`; `None`
/// where it is matte.
pub fn read(
    materials: &mut Materials,
    prim: &Prim,
    shader: &Prim,
    id: &str,
    base: (Rgb, Option<TextureSlot>),
    w: &mut Reading,
) -> Option<Appearance> {
    let inputs = inputs(id);
    let mut look = Appearance { base_color: base.0, base_color_texture: base.1, ..Appearance::default() };
    look.measured = lobes(prim, w);
    let mut number = |(name, default): (&str, f32), w: &mut Reading| materials.channel(shader, name, default, w);
    (look.roughness, look.roughness_texture) = number(inputs.roughness, w);
    (look.clearcoat, look.clearcoat_texture) = number((inputs.clearcoat, 0.0), w);
    if look.clearcoat > 0.0 {
        (look.clearcoat_roughness, look.clearcoat_roughness_texture) = number(inputs.clearcoat_roughness, w);
    }
    let is_workflow = inputs.specular.is_none()
        && network::input(shader, "useSpecularWorkflow", w).and_then(read::to_float).is_some_and(|v| v != 0.0);
    if is_workflow {
        let (color, color_texture) = materials.color(shader, "specularColor", Rgb::ZERO, w);
        look.dielectric = Dielectric { ior: 0.0, color, color_texture, ..Dielectric::default() };
    } else {
        (look.metallic, look.metallic_texture) = number(inputs.metallic, w);
        look.dielectric.ior = number((inputs.ior, 1.5), w).0;
        if let Some((weight, color)) = inputs.specular {
            (look.dielectric.specular, look.dielectric.specular_texture) = number((weight, 1.0), w);
            (look.dielectric.color, look.dielectric.color_texture) = materials.color(shader, color, Rgb::ONE, w);
        }
    }
    if let Some(transmission) = inputs.transmission {
        (look.transmission, look.transmission_texture) = materials.channel(shader, transmission, 0.0, w);
        let thickness = network::input(shader, "thickness", w).and_then(read::to_float).unwrap_or(0.0);
        if look.transmission > 0.0 && id == "ND_gltf_pbr_surfaceshader" && thickness > 0.0 {
            look.walls = Walls::Solid { absorption: absorption(materials, shader, w) };
        }
    }
    look.bound().into_iter().for_each(|fault| w.add(prim.path(), fault));
    (!look.is_matte()).then_some(look)
}

/// Absorption [1/m] of gltf_pbr's volume: what is left is attenuation_color after attenuation_distance.
fn absorption(materials: &mut Materials, shader: &Prim, w: &mut Reading) -> Rgb {
    let left = materials.color(shader, "attenuation_color", Rgb::ONE, w).0.clamp(Rgb::splat(1e-6), Rgb::ONE);
    let distance = network::input(shader, "attenuation_distance", w).and_then(read::to_float).unwrap_or(f32::INFINITY);
    let absorption = -Rgb::new(left.x.ln(), left.y.ln(), left.z.ln()) / distance;
    if distance > 0.0 && absorption.is_finite() { absorption } else { Rgb::ZERO }
}

/// The lobes of a Material prim; wrong ones are a warning.
fn lobes(prim: &Prim, w: &mut Reading) -> Option<Lobes> {
    const NAME: &str = "lumel:lobes";
    if !read::is_authored(prim, NAME) {
        return None;
    }
    let place = format!("{}.{NAME}", prim.path());
    let numbers = read::value(prim, NAME, w).and_then(read::to_floats).unwrap_or_default();
    if numbers.len() < 3 || !(numbers.len() - 3).is_multiple_of(12) {
        w.add(place, "must hold 3 numbers, and 12 for each lobe; it was ignored");
        return None;
    }
    let rgb: Vec<Rgb> = numbers.chunks_exact(3).map(Rgb::from_slice).collect();
    let lobe = |c: &[Rgb]| Lobe { x: c[0], y: c[1], z: c[2], exponent: c[3] };
    let lobes = Lobes { diffuse: rgb[0], lobes: rgb[1..].chunks_exact(4).map(lobe).collect() };
    match lobes.fault() {
        Some(fault) => {
            w.add(place, format!("{fault}; it was ignored"));
            None
        }
        None => Some(lobes),
    }
}

/// The channel that a texture's `output` names; colours are read by their first.
pub fn channel(slot: TextureSlot, output: &str) -> ChannelSlot {
    let channel = match output {
        "g" => Channel::G,
        "b" => Channel::B,
        "a" => Channel::A,
        _ => Channel::R,
    };
    ChannelSlot { slot, channel }
}
