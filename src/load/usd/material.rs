//! Materials as diffuse ones: UsdPreviewSurface, and the base colour and emission of MaterialX and Arnold surfaces.

use super::mesh::MaterialUse;
use super::network::{self, Origin};
use super::read;
use super::texture::{Sampled, Textures};
use crate::color::Rgb;
use crate::error::Warnings;
use crate::scene::{Alpha, Material, Texture, TextureSlot};
use glam::Vec3;
use openusd::sdf::Path;
use openusd::usd::{Prim, Stage};
use std::collections::HashMap;
use std::path::PathBuf;

/// What a mesh looks like where no material is bound.
#[derive(Clone, Copy)]
pub struct Fallback {
    /// A displayColor that holds for the whole mesh.
    pub color: Option<Vec3>,
    pub opacity: Option<f32>,
    /// displayColor varies over the mesh.
    pub varying: bool,
}

/// The scene's materials and textures in the making.
#[derive(Default)]
pub struct Materials {
    materials: Vec<Material>,
    textures: Textures,
    used: HashMap<Key, MaterialUse>,
    parsed: HashMap<String, Option<Parsed>>,
}

/// Materials are made for each side and fallback colour that they are used with.
#[derive(PartialEq, Eq, Hash)]
struct Key {
    material: Option<String>,
    double_sided: bool,
    fallback: Option<[u32; 4]>,
    varying: bool,
}

/// A material network that was understood.
#[derive(Clone)]
struct Parsed {
    material: Material,
    display_color: bool,
}

/// A colour input: `factor`, times the texture, times the display colour.
struct ColorInput {
    factor: Rgb,
    texture: Option<TextureSlot>,
    display_color: bool,
}

/// The inputs of a surface shader that matter here.
struct SurfaceInputs {
    color: &'static str,
    color_default: f32,
    /// Scales the colour.
    color_weight: Option<&'static str>,
    emission: &'static str,
    /// Scales the emission; 0 unless authored.
    emission_weight: Option<&'static str>,
    metalness: &'static str,
    opacity: &'static str,
}

/// The inputs of the shader `id`, `None` where it is not known.
fn surface_inputs(id: &str) -> Option<SurfaceInputs> {
    let preview = SurfaceInputs {
        color: "diffuseColor",
        color_default: 0.18,
        color_weight: None,
        emission: "emissiveColor",
        emission_weight: None,
        metalness: "metallic",
        opacity: "opacity",
    };
    let standard = SurfaceInputs {
        color: "base_color",
        color_default: 0.8,
        color_weight: Some("base"),
        emission: "emission_color",
        emission_weight: Some("emission"),
        metalness: "metalness",
        opacity: "opacity",
    };
    match id {
        "UsdPreviewSurface" | "ND_UsdPreviewSurface_surfaceshader" => Some(preview),
        "ND_standard_surface_surfaceshader" | "arnold:standard_surface" | "standard_surface" => Some(standard),
        "ND_open_pbr_surface_surfaceshader" => Some(SurfaceInputs {
            color_weight: Some("base_weight"),
            emission_weight: Some("emission_luminance"),
            metalness: "base_metalness",
            opacity: "geometry_opacity",
            ..standard
        }),
        "ND_gltf_pbr_surfaceshader" => Some(SurfaceInputs {
            color_default: 1.0,
            color_weight: None,
            emission: "emissive",
            metalness: "metallic",
            opacity: "alpha",
            ..standard
        }),
        _ => None,
    }
}

impl Materials {
    /// The material bound at `bound`, for one- or double-sided use; without one, or where it is not understood, the
    /// display colour, else grey.
    pub fn usage(
        &mut self,
        stage: &Stage,
        bound: Option<Path>,
        double_sided: bool,
        fallback: Fallback,
        warnings: &mut Warnings,
    ) -> MaterialUse {
        let prim = bound.and_then(|path| {
            let prim = stage.prim(path.clone()).ok().filter(|prim| prim.is_valid().unwrap_or(false));
            if prim.is_none() {
                warnings.add(path, "a bound material was not found");
            }
            // Instances of one prototype share its materials.
            prim.map(|prim| prim.prim_in_prototype().ok().flatten().unwrap_or(prim))
        });
        let parsed = prim.as_ref().and_then(|prim| self.parse(prim, warnings));
        let color = fallback.color.unwrap_or(Material::default().albedo);
        let opacity = fallback.opacity.unwrap_or(1.0);
        let key = Key {
            material: parsed.as_ref().map(|p| p.material.name.clone()),
            double_sided,
            fallback: parsed.is_none().then(|| [color.x, color.y, color.z, opacity].map(f32::to_bits)),
            varying: parsed.is_none() && fallback.varying,
        };
        if let Some(&usage) = self.used.get(&key) {
            return usage;
        }
        let Parsed { material, display_color } = parsed.unwrap_or_else(|| Parsed {
            material: Material {
                name: "displayColor".to_owned(),
                albedo: if fallback.varying { Rgb::ONE } else { color.clamp(Rgb::ZERO, Rgb::ONE) },
                alpha: if opacity < 1.0 { Alpha::Blend { opacity } } else { Alpha::Opaque },
                ..Material::default()
            },
            display_color: fallback.varying,
        });
        let usage = MaterialUse { index: self.materials.len() as u32, display_color };
        self.materials.push(Material { double_sided, ..material });
        self.used.insert(key, usage);
        usage
    }

    pub fn all(&self) -> &[Material] {
        &self.materials
    }

    pub fn textures(&mut self) -> &mut Textures {
        &mut self.textures
    }

    /// Materials, textures and the texture files that were read.
    pub fn into_parts(self) -> (Vec<Material>, Vec<Texture>, Vec<PathBuf>) {
        (self.materials, self.textures.textures, self.textures.files)
    }

    fn parse(&mut self, prim: &Prim, warnings: &mut Warnings) -> Option<Parsed> {
        let name = prim.path().as_str().to_owned();
        if let Some(known) = self.parsed.get(&name) {
            return known.clone();
        }
        let parsed = self.parse_network(prim, warnings);
        self.parsed.insert(name, parsed.clone());
        parsed
    }

    fn parse_network(&mut self, prim: &Prim, warnings: &mut Warnings) -> Option<Parsed> {
        // The general output first, then MaterialX', then any renderer's own.
        let mut outputs = vec!["outputs:surface".to_owned(), "outputs:mtlx:surface".to_owned()];
        let names = prim.authored_property_names().unwrap_or_default();
        outputs.extend(names.iter().filter(|n| is_surface_output(n.as_str())).map(|n| n.as_str().to_owned()));
        let mut unknown = Vec::new();
        for output in outputs {
            let Origin::Shader { shader, .. } = network::trace(&prim.attribute(output), warnings) else { continue };
            let id = network::shader_id(&shader, warnings);
            if let Some(inputs) = surface_inputs(&id) {
                if id != "UsdPreviewSurface" {
                    let message = format!("of {id} only the base colour and the emission are used");
                    warnings.add(prim.path(), message);
                }
                return Some(self.parse_surface(prim, &shader, &inputs, warnings));
            }
            if !unknown.contains(&id) {
                unknown.push(id);
            }
        }
        let message = if unknown.is_empty() {
            "a material without a surface shader was replaced by the display colour".to_owned()
        } else {
            format!("the surface shader {} is not supported; the display colour is used", unknown.join(", "))
        };
        warnings.add(prim.path(), message);
        None
    }

    fn parse_surface(&mut self, prim: &Prim, shader: &Prim, inputs: &SurfaceInputs, w: &mut Warnings) -> Parsed {
        let base = self.color_input(shader, inputs.color, Rgb::splat(inputs.color_default), w);
        let weight = inputs.color_weight.and_then(|name| float(shader, name, w)).unwrap_or(1.0);
        let emission = self.emission(shader, inputs, w);
        let albedo = base.factor * weight;
        if albedo.max_element() > 1.0 || albedo.min_element() < 0.0 {
            w.add(prim.path(), "an albedo outside 0..1 was clamped");
        }
        let specular_workflow = float(shader, "useSpecularWorkflow", w).is_some_and(|v| v != 0.0);
        let metalness = shader.attribute(format!("inputs:{}", inputs.metalness));
        let metal = match network::trace(&metalness, w) {
            Origin::Value(value) => value.and_then(read::to_float).is_some_and(|v| v > 0.0),
            Origin::Shader { .. } => true,
        };
        if metal && !specular_workflow {
            w.add(prim.path(), "a metal is taken as a diffuse surface of the same base colour");
        }
        let material = Material {
            name: prim.path().as_str().to_owned(),
            albedo: albedo.clamp(Rgb::ZERO, Rgb::ONE),
            albedo_texture: base.texture,
            emission: emission.factor.max(Rgb::ZERO),
            emission_texture: emission.texture,
            double_sided: false,
            alpha: self.alpha(prim, shader, inputs, w),
            ..Material::default()
        };
        Parsed { material, display_color: base.display_color }
    }

    fn emission(&mut self, shader: &Prim, inputs: &SurfaceInputs, w: &mut Warnings) -> ColorInput {
        let mut weight = 1.0;
        let mut default = Rgb::ZERO;
        if let Some(name) = inputs.emission_weight {
            weight = float(shader, name, w).unwrap_or(0.0);
            default = Rgb::ONE;
        }
        if weight == 0.0 {
            return ColorInput { factor: Rgb::ZERO, texture: None, display_color: false };
        }
        let mut emission = self.color_input(shader, inputs.emission, default, w);
        if emission.display_color {
            w.add(shader.path(), "an emission that reads displayColor is taken as white");
        }
        emission.factor *= weight;
        emission
    }

    fn alpha(&mut self, prim: &Prim, shader: &Prim, inputs: &SurfaceInputs, w: &mut Warnings) -> Alpha {
        let (opacity, textured) = match network::trace(&shader.attribute(format!("inputs:{}", inputs.opacity)), w) {
            Origin::Value(value) => {
                let scalar = value.and_then(|v| read::to_float(v.clone()).or_else(|| Some(read::to_vec3(v)?.x)));
                (scalar.unwrap_or(1.0).clamp(0.0, 1.0), false)
            }
            Origin::Shader { .. } => (1.0, true),
        };
        let cutoff = float(shader, "opacityThreshold", w).unwrap_or(0.0);
        if opacity >= 1.0 && !textured {
            return Alpha::Opaque;
        }
        w.add(prim.path(), "opacity is not supported yet; the material is treated as opaque for now");
        if cutoff > 0.0 { Alpha::Mask { cutoff, opacity } } else { Alpha::Blend { opacity } }
    }

    fn color_input(&mut self, shader: &Prim, name: &str, default: Rgb, w: &mut Warnings) -> ColorInput {
        let constant = |factor: Rgb| ColorInput {
            factor: if factor.is_finite() { factor } else { default },
            texture: None,
            display_color: false,
        };
        let (node, output) = match network::trace(&shader.attribute(format!("inputs:{name}")), w) {
            Origin::Value(value) => return constant(value.and_then(read::to_vec3).unwrap_or(default)),
            Origin::Shader { shader, output } => (shader, output),
        };
        match self.textures.sample(&node, &output, w) {
            Some(Sampled::Slot(slot)) => {
                return ColorInput { factor: Rgb::ONE, texture: Some(slot), display_color: false };
            }
            Some(Sampled::Missing(fallback)) => return constant(fallback.map_or(default, |f| f.truncate())),
            None => {}
        }
        let id = network::shader_id(&node, w);
        let is_reader = id.starts_with("UsdPrimvarReader") || id.starts_with("ND_geompropvalue");
        if is_reader {
            let varname = ["varname", "geomprop"].into_iter().find_map(|name| {
                network::input(&node, name, w).and_then(read::to_text).filter(|name| !name.is_empty())
            });
            if varname.as_deref() == Some("displayColor") {
                return ColorInput { factor: Rgb::ONE, texture: None, display_color: true };
            }
            let varname = varname.unwrap_or_default();
            w.add(node.path(), format!("a colour from primvar {varname} is not supported; a constant is used"));
            return constant(network::input(&node, "fallback", w).and_then(read::to_vec3).unwrap_or(default));
        }
        if id.starts_with("ND_constant_color") {
            return constant(network::input(&node, "value", w).and_then(read::to_vec3).unwrap_or(default));
        }
        w.add(node.path(), format!("the shader node {id} is not supported; the input's default is used"));
        constant(default)
    }
}

fn is_surface_output(name: &str) -> bool {
    name.starts_with("outputs:") && name.ends_with(":surface")
}

fn float(shader: &Prim, name: &str, warnings: &mut Warnings) -> Option<f32> {
    match network::trace(&shader.attribute(format!("inputs:{name}")), warnings) {
        Origin::Value(value) => value.and_then(read::to_float),
        Origin::Shader { .. } => {
            warnings.add(shader.path(), format!("the connection of input {name} is not supported and was left out"));
            None
        }
    }
}
