//! Materials as diffuse ones: UsdPreviewSurface, and of MaterialX and Arnold surfaces what a diffuse one has.
//!
//! | surface | albedo | emission [nit] | opacity | transmission, which the albedo loses |
//! |---|---|---|---|---|
//! | UsdPreviewSurface | diffuseColor | emissiveColor | opacity; a mask where opacityThreshold > 0 | |
//! | standard_surface | base, base_color | emission, emission_color | mean of opacity | transmission, transmission_color |
//! | open_pbr_surface | base_weight, base_color | emission_luminance, emission_color | geometry_opacity | the same |
//! | gltf_pbr | base_color | emissive, emissive_strength | alpha as alpha_mode says | transmission |
//!
//! Colours are constants, textures, the primvar displayColor, or products of these. Metals count as diffuse surfaces of
//! the same colour; a coat, a sheen or scattering below the surface is not followed.

use super::mesh::MaterialUse;
use super::network::{self, Origin};
use super::read::{self, Reading};
use super::texture::{Sampled, Textures};
use super::udim;
use super::{appearance, contribution};
use crate::color::Rgb;
use crate::load::access::Access;
use crate::scene::{Alpha, ChannelSlot, Contribution, Material, Mesh, Texture, TextureSlot};
use glam::{Vec3, Vec4};
use openusd::sdf::{Path, Value};
use openusd::usd::{Attribute, Prim, Stage};
use std::collections::HashMap;
use std::path::PathBuf;

/// What a mesh looks like where no material is bound.
#[derive(Clone, Copy)]
pub struct Fallback {
    /// A displayColor that holds for the whole mesh.
    pub color: Option<Vec3>,
    pub opacity: Option<f32>,
    /// displayColor or displayOpacity varies over the mesh.
    pub varying: bool,
    /// displayOpacity does.
    pub varying_opacity: bool,
}

/// The scene's materials and textures in the making.
pub struct Materials {
    materials: Vec<Material>,
    textures: Textures,
    used: HashMap<Key, MaterialUse>,
    parsed: HashMap<String, Option<Parsed>>,
    /// Looks beyond the diffuse are read too.
    appearance: bool,
}

/// Materials are made for each side and fallback colour that they are used with.
#[derive(PartialEq, Eq, Hash)]
struct Key {
    material: Option<String>,
    double_sided: bool,
    fallback: Option<[u32; 4]>,
    varying: [bool; 2],
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
    /// The texture's output that is read: `rgb`, `r`, `a`, ...
    output: String,
    display_color: bool,
}

/// The inputs of a surface shader that matter here.
#[derive(Clone, Copy)]
struct SurfaceInputs {
    color: &'static str,
    color_default: f32,
    /// Scales the colour; 1 unless authored.
    color_weight: Option<&'static str>,
    emission: &'static str,
    /// Scales the emission, and what it is unless authored.
    emission_weight: Option<(&'static str, f32)>,
    metalness: &'static str,
    opacity: &'static str,
    /// Opacity below it is none; 0: opacity blends.
    cutoff: Option<&'static str>,
    /// Weight and colour.
    transmission: Option<(&'static str, Option<&'static str>)>,
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
        cutoff: Some("opacityThreshold"),
        transmission: None,
    };
    let standard = SurfaceInputs {
        color: "base_color",
        color_default: 0.8,
        color_weight: Some("base"),
        emission: "emission_color",
        emission_weight: Some(("emission", 0.0)),
        metalness: "metalness",
        opacity: "opacity",
        cutoff: None,
        transmission: Some(("transmission", Some("transmission_color"))),
    };
    match id {
        "UsdPreviewSurface" | "ND_UsdPreviewSurface_surfaceshader" => Some(preview),
        "ND_standard_surface_surfaceshader" | "arnold:standard_surface" | "standard_surface" => Some(standard),
        "ND_open_pbr_surface_surfaceshader" => Some(SurfaceInputs {
            color_weight: Some("base_weight"),
            emission_weight: Some(("emission_luminance", 0.0)),
            metalness: "base_metalness",
            opacity: "geometry_opacity",
            transmission: Some(("transmission_weight", Some("transmission_color"))),
            ..standard
        }),
        "ND_gltf_pbr_surfaceshader" => Some(SurfaceInputs {
            color_default: 1.0,
            color_weight: None,
            emission: "emissive",
            emission_weight: Some(("emissive_strength", 1.0)),
            metalness: "metallic",
            opacity: "alpha",
            cutoff: Some("alpha_cutoff"),
            transmission: Some(("transmission", None)),
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
        warnings: &mut Reading,
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
            varying: [fallback.varying, fallback.varying_opacity].map(|v| v && parsed.is_none()),
        };
        if let Some(&usage) = self.used.get(&key) {
            return usage;
        }
        let Parsed { material, display_color } = parsed.unwrap_or_else(|| Parsed {
            material: Material {
                name: "displayColor".to_owned(),
                albedo: if fallback.varying { Rgb::ONE } else { color.clamp(Rgb::ZERO, Rgb::ONE) },
                alpha: match fallback.varying_opacity {
                    true => Alpha::Blend { opacity: 1.0 },
                    false if opacity < 1.0 => Alpha::Blend { opacity: opacity.max(0.0) },
                    false => Alpha::Opaque,
                },
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

    /// None yet; textures are those that `access` allows. `appearance`: what is not diffuse is read too.
    pub fn new(access: &Access, appearance: bool) -> Self {
        let textures = Textures::new(access);
        Self { materials: Vec::new(), textures, used: HashMap::new(), parsed: HashMap::new(), appearance }
    }

    pub fn textures(&mut self) -> &mut Textures {
        &mut self.textures
    }

    /// Materials, textures and the texture files that were read.
    pub fn into_parts(self) -> (Vec<Material>, Vec<Texture>, Vec<PathBuf>) {
        (self.materials, self.textures.textures, self.textures.files)
    }

    fn parse(&mut self, prim: &Prim, warnings: &mut Reading) -> Option<Parsed> {
        let name = prim.path().as_str().to_owned();
        if let Some(known) = self.parsed.get(&name) {
            return known.clone();
        }
        let parsed = self.parse_network(prim, warnings);
        self.parsed.insert(name, parsed.clone());
        parsed
    }

    fn parse_network(&mut self, prim: &Prim, warnings: &mut Reading) -> Option<Parsed> {
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
                    let message = format!("of {id} only base colour, emission, opacity and transmission are used");
                    warnings.add(prim.path(), message);
                }
                let mut parsed = self.parse_surface(prim, &shader, &inputs, warnings);
                if self.appearance {
                    let base = self.base_color(&shader, &inputs, &parsed.material, warnings);
                    let look = appearance::read(self, prim, &shader, &id, base, warnings);
                    parsed.material.appearance = look;
                }
                return Some(parsed);
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

    fn parse_surface(&mut self, prim: &Prim, shader: &Prim, inputs: &SurfaceInputs, w: &mut Reading) -> Parsed {
        let mut base = self.color_input(shader, inputs.color, Rgb::splat(inputs.color_default), w);
        let weight = inputs.color_weight.and_then(|name| float(shader, name, w)).unwrap_or(1.0);
        let emission = self.emission(shader, inputs, w);
        let (transmission, share) = self.transmission(shader, inputs, w);
        let albedo = base.factor * weight * (1.0 - share);
        if albedo.max_element() > 1.0 || albedo.min_element() < 0.0 {
            w.add(prim.path(), "an albedo outside 0..1 was clamped");
        }
        if base.texture.is_some() && base.output.len() == 1 {
            w.add(shader.path(), "a single channel feeds a colour; the texture's RGB is used");
        }
        report_metal(prim, shader, inputs, w);
        let (alpha, opacity_texture) = self.alpha(shader, inputs, &mut base, w);
        let names = prim.authored_property_names().unwrap_or_default();
        let material = Material {
            name: prim.path().as_str().to_owned(),
            albedo: albedo.clamp(Rgb::ZERO, Rgb::ONE),
            albedo_texture: base.texture,
            emission: emission.factor.max(Rgb::ZERO),
            emission_texture: emission.texture,
            double_sided: false,
            alpha,
            opacity_texture,
            transmission: transmission.factor.clamp(Rgb::ZERO, Rgb::ONE),
            transmission_texture: transmission.texture,
            contribution: contribution::opinion(prim, &names, &Contribution::default(), w),
            appearance: None,
        };
        Parsed { material, display_color: base.display_color }
    }

    /// The base colour, as it is without what passes, and its texture.
    fn base_color(
        &mut self,
        shader: &Prim,
        inputs: &SurfaceInputs,
        material: &Material,
        w: &mut Reading,
    ) -> (Rgb, Option<TextureSlot>) {
        let base = self.color_input(shader, inputs.color, Rgb::splat(inputs.color_default), w);
        let weight = inputs.color_weight.and_then(|name| float(shader, name, w)).unwrap_or(1.0);
        ((base.factor * weight).clamp(Rgb::ZERO, Rgb::ONE), material.albedo_texture.clone())
    }

    /// The number `name` of `shader`, and the texture that multiplies it.
    pub fn channel(&mut self, shader: &Prim, name: &str, default: f32, w: &mut Reading) -> (f32, Option<ChannelSlot>) {
        let found = self.color_input(shader, name, Rgb::splat(default), w);
        (found.factor.x, found.texture.map(|slot| appearance::channel(slot, &found.output)))
    }

    /// The colour `name` of `shader`, and the texture that multiplies it.
    pub fn color(&mut self, shader: &Prim, name: &str, default: Rgb, w: &mut Reading) -> (Rgb, Option<TextureSlot>) {
        let found = self.color_input(shader, name, default, w);
        (found.factor, found.texture)
    }

    fn emission(&mut self, shader: &Prim, inputs: &SurfaceInputs, w: &mut Reading) -> ColorInput {
        let mut weight = 1.0;
        let mut default = Rgb::ZERO;
        if let Some((name, unless_authored)) = inputs.emission_weight {
            weight = float(shader, name, w).unwrap_or(unless_authored);
            default = if unless_authored == 0.0 { Rgb::ONE } else { Rgb::ZERO };
        }
        if weight == 0.0 {
            return ColorInput::constant(Rgb::ZERO);
        }
        let mut emission = self.color_input(shader, inputs.emission, default, w);
        if emission.display_color {
            w.add(shader.path(), "an emission that reads displayColor is taken as white");
        }
        emission.factor *= weight;
        emission
    }

    /// What passes through, and the share of the light that it takes from the diffuse part.
    fn transmission(&mut self, shader: &Prim, inputs: &SurfaceInputs, w: &mut Reading) -> (ColorInput, f32) {
        let none = (ColorInput::constant(Rgb::ZERO), 0.0);
        let Some((weight, color)) = inputs.transmission else { return none };
        let weight = float(shader, weight, w).unwrap_or(0.0).clamp(0.0, 1.0);
        if weight == 0.0 {
            return none;
        }
        let mut transmission = match color {
            Some(color) => self.color_input(shader, color, Rgb::ONE, w),
            None => ColorInput::constant(Rgb::ONE),
        };
        transmission.factor *= weight;
        (transmission, weight)
    }

    /// The alpha, and the texture that it is read from where that is not the alpha of the `base` colour's.
    fn alpha(
        &mut self,
        shader: &Prim,
        inputs: &SurfaceInputs,
        base: &mut ColorInput,
        w: &mut Reading,
    ) -> (Alpha, Option<TextureSlot>) {
        let found = self.color_input(shader, inputs.opacity, Rgb::ONE, w);
        let opacity = (found.factor.element_sum() / 3.0).clamp(0.0, 1.0);
        if opacity >= 1.0 && found.texture.is_none() {
            return (Alpha::Opaque, None);
        }
        if found.display_color {
            w.add(shader.path(), "an opacity that reads displayColor is taken as 1");
        }
        // glTF says by a number whether alpha means nothing (0, unless authored), cuts or blends; others by the cutoff.
        let mode = (inputs.opacity == "alpha").then(|| float(shader, "alpha_mode", w).unwrap_or(0.0));
        if mode == Some(0.0) {
            return (Alpha::Opaque, None);
        }
        let default = if mode.is_some() { 0.5 } else { 0.0 };
        let cutoff = inputs.cutoff.filter(|_| mode.is_none_or(|mode| mode == 1.0));
        let cutoff = cutoff.map_or(0.0, |name| float(shader, name, w).unwrap_or(default));
        let alpha = if cutoff > 0.0 { Alpha::Mask { cutoff, opacity } } else { Alpha::Blend { opacity } };
        let own = base.texture.as_mut();
        let is_of_base = found.output == "a"
            && found.texture.as_ref().zip(own.as_deref()).is_some_and(|(a, b)| {
                (a.texture, &a.uv_set, a.image_from_uv, a.wrap) == (b.texture, &b.uv_set, b.image_from_uv, b.wrap)
            });
        if is_of_base {
            return (alpha, None);
        }
        // The colour's own alpha means nothing here.
        if let Some(slot) = own {
            (slot.scale.w, slot.bias.w) = (0.0, 1.0);
        }
        (alpha, found.texture.map(|slot| self.textures.with_alpha(slot, &found.output)))
    }

    fn color_input(&mut self, shader: &Prim, name: &str, default: Rgb, w: &mut Reading) -> ColorInput {
        self.color_at(&shader.attribute(format!("inputs:{name}")), default, MAX_PRODUCTS, w)
    }

    /// What `attribute` shows, through products of at most `depth` factors.
    fn color_at(&mut self, attribute: &Attribute, default: Rgb, depth: usize, w: &mut Reading) -> ColorInput {
        let constant = |factor: Rgb| ColorInput::constant(if factor.is_finite() { factor } else { default });
        let (node, output) = match network::trace(attribute, w) {
            Origin::Value(value) => return constant(value.and_then(to_rgb).unwrap_or(default)),
            Origin::Shader { shader, output } => (shader, output),
        };
        match self.textures.sample(&node, w) {
            Some(Sampled::Slot(slot)) => {
                return ColorInput { factor: Rgb::ONE, texture: Some(slot), output, display_color: false };
            }
            Some(Sampled::Missing(fallback)) => return constant(fallback.map_or(default, |f| channels(f, &output))),
            None => {}
        }
        let id = network::shader_id(&node, w);
        if id.starts_with("UsdPrimvarReader") || id.starts_with("ND_geompropvalue") {
            return primvar_color(&node, default, w);
        }
        let input = |name: &str| node.attribute(format!("inputs:{name}"));
        if id.starts_with("ND_constant_") {
            return constant(network::input(&node, "value", w).and_then(to_rgb).unwrap_or(default));
        }
        if depth > 0 && (id.starts_with("ND_convert_") || id.starts_with("ND_dot_")) {
            return self.color_at(&input("in"), default, depth - 1, w);
        }
        if depth > 0 && id.starts_with("ND_multiply_") {
            let [a, b] = ["in1", "in2"].map(|name| self.color_at(&input(name), Rgb::ONE, depth - 1, w));
            if a.texture.is_some() && b.texture.is_some() {
                w.add(node.path(), "a product of two textures is not supported; the first is used");
            }
            let (texture, output) = if a.texture.is_some() { (a.texture, a.output) } else { (b.texture, b.output) };
            let display_color = a.display_color || b.display_color;
            return ColorInput { factor: a.factor * b.factor, texture, output, display_color };
        }
        w.add(node.path(), format!("the shader node {id} is not supported; the input's default is used"));
        constant(default)
    }

    /// The same material shining by itself: `factor` on its own emission, or in place of it.
    pub fn shining(&mut self, index: u32, glow: &Glow) -> u32 {
        let Some(base) = self.materials.get(index as usize) else { return index };
        let mut material = base.clone();
        material.name = format!("{} ({})", base.name, glow.light);
        material.contribution = glow.contribution.over(&base.contribution);
        match glow.sync {
            Sync::Tint if material.is_emissive() => material.emission *= glow.radiance,
            Sync::Tint | Sync::Independent | Sync::NoResponse => {
                (material.emission, material.emission_texture) = (glow.radiance, None);
            }
        }
        if glow.sync == Sync::NoResponse {
            (material.albedo, material.transmission, material.appearance) = (Rgb::ZERO, Rgb::ZERO, None);
        }
        self.materials.push(material);
        self.materials.len() as u32 - 1
    }

    /// Gives each face of `mesh` whose material has tiled pictures (UDIM) the tile that its UVs lie in.
    pub fn choose_tiles(&mut self, mesh: &mut Mesh, w: &mut Reading) {
        udim::choose_tiles(mesh, &mut self.materials, &self.textures, w);
    }
}

/// Products within products are followed so far.
const MAX_PRODUCTS: usize = 8;

/// How a mesh light's own light and its material's go together (UsdLux: materialSyncMode).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Sync {
    /// The material's emission tints the light.
    Tint,
    /// The light's colour alone.
    Independent,
    /// The same, and the surface reflects nothing.
    NoResponse,
}

/// The light of a surface.
pub struct Glow<'a> {
    /// The light's path.
    pub light: &'a str,
    /// [nit]
    pub radiance: Rgb,
    pub sync: Sync,
    /// What is said of how it is baked, which goes before what the material says.
    pub contribution: &'a Contribution,
}

impl ColorInput {
    fn constant(factor: Rgb) -> Self {
        Self { factor, texture: None, output: String::new(), display_color: false }
    }
}

/// What the output `output` of a texture node tells of its value: one channel for all three, or the colour.
fn channels(value: Vec4, output: &str) -> Rgb {
    match output {
        "r" => Rgb::splat(value.x),
        "g" => Rgb::splat(value.y),
        "b" => Rgb::splat(value.z),
        "a" => Rgb::splat(value.w),
        _ => value.truncate(),
    }
}

/// A colour, or a number for all three channels.
fn to_rgb(value: Value) -> Option<Rgb> {
    read::to_vec3(value.clone())
        .or_else(|| read::to_vec4(value.clone()).map(|v| v.truncate()))
        .or_else(|| read::to_float(value).map(Rgb::splat))
}

fn primvar_color(node: &Prim, default: Rgb, w: &mut Reading) -> ColorInput {
    let mut name = |input: &str| network::input(node, input, w).and_then(read::to_text).filter(|name| !name.is_empty());
    let varname = name("varname").or_else(|| name("geomprop")).unwrap_or_default();
    if varname == "displayColor" {
        return ColorInput { display_color: true, ..ColorInput::constant(Rgb::ONE) };
    }
    w.add(node.path(), format!("a colour from primvar {varname} is not supported; a constant is used"));
    let fallback = network::input(node, "fallback", w).or_else(|| network::input(node, "default", w));
    ColorInput::constant(fallback.and_then(to_rgb).filter(|c| c.is_finite()).unwrap_or(default))
}

fn report_metal(prim: &Prim, shader: &Prim, inputs: &SurfaceInputs, w: &mut Reading) {
    let specular_workflow = float(shader, "useSpecularWorkflow", w).is_some_and(|v| v != 0.0);
    let metalness = shader.attribute(format!("inputs:{}", inputs.metalness));
    let metal = match network::trace(&metalness, w) {
        Origin::Value(value) => value.and_then(read::to_float).is_some_and(|v| v > 0.0),
        Origin::Shader { .. } => true,
    };
    if metal && !specular_workflow {
        w.add(prim.path(), "a metal is taken as a diffuse surface of the same base colour");
    }
}

fn is_surface_output(name: &str) -> bool {
    name.starts_with("outputs:") && name.ends_with(":surface")
}

fn float(shader: &Prim, name: &str, warnings: &mut Reading) -> Option<f32> {
    match network::trace(&shader.attribute(format!("inputs:{name}")), warnings) {
        Origin::Value(value) => value.and_then(read::to_float),
        Origin::Shader { .. } => {
            warnings.add(shader.path(), format!("the connection of input {name} is not supported and was left out"));
            None
        }
    }
}
