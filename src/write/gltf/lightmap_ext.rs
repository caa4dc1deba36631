//! Vendors' extensions that name lightmaps in the GLB itself, beside the `lumel` extras:
//!
//! | extension | stands on | texture | UVs | decoded as |
//! |---|---|---|---|---|
//! | `MOZ_lightmap` (Hubs) | materials: `index`, `texCoord`, `intensity` | Radiance HDR by `MOZ_texture_rgbe` | of the page | `material.lightMap` of three.js |
//! | `MX_lightmap` (Third Room) | nodes: `lightMapTexture`, `scale`, `offset`, `intensity` | PNG with a multiplier | of the mesh | by the viewer |
//! | `NEEDLE_lightmaps` (Needle Engine) | the root: `textures` of `type` 0, `index`, `pointer`; nodes: a `MeshRenderer` with `lightmapIndex` and `lightmapScaleOffset`, v up | PNG with a multiplier and sRGB's curve | of the mesh | RGBM of the engine |
//!
//! NEEDLE_lightmaps was read in the engine's package (`NEEDLE_lightmaps.ts`, `RendererLightmap.ts`, version 4.16);
//! MOZ_lightmap and MX_lightmap follow their vendors' descriptions and were not tried in a viewer.
//!
//! MOZ_lightmap knows no rectangle, so meshes get UVs of the page, one mesh a node, and a material that surfaces on
//! several pages share becomes one for each page.

use super::document::{Document, Object, index, number, numbers};
use super::primitive::{material_indices, primitive_json, primitive_json_mut};
use super::{accessor, engine, extras, import, instances};
use crate::error::{Error, Result, Warnings};
use crate::unwrap::Placement;
use crate::write::Baked;
use crate::write::encode::{Encoded, Encoding};
use crate::write::engines::{Engine, LightmapExtension, Vertical, rectangle};
use glam::Vec2;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};

const MOZ: &str = "MOZ_lightmap";
const MOZ_RGBE: &str = "MOZ_texture_rgbe";
const MX: &str = "MX_lightmap";
const NEEDLE: &str = "NEEDLE_lightmaps";
const NEEDLE_COMPONENTS: &str = "NEEDLE_components";

/// Linear filter and clamped coordinates, as WebGL numbers them.
const LINEAR: u32 = 9729;
const CLAMP: u32 = 33071;

/// A node with a lightmap.
struct Placed {
    node: usize,
    mesh: usize,
    tex_coord: usize,
    placement: Placement,
}

/// Names the pages of `baked` in a document that has the `lumel` extras of this bake.
///
/// # Errors
/// `Invalid` where no page was written in a form that the extension can name, or the document is broken.
pub fn write(doc: &mut Document, baked: &Baked, extension: LightmapExtension, warnings: &mut Warnings) -> Result<()> {
    let form = extension.encodings().iter().find_map(|e| baked.encoded.iter().find(|f| f.encoding == *e));
    let form = form.ok_or_else(|| {
        let names: Vec<&str> = extension.encodings().iter().map(|e| e.name()).collect();
        let message = format!("needs pages as {}; add it to encoding", names.join(" or "));
        Error::invalid(format!("gltf-lightmap-ext {}", extension.name()), message)
    })?;
    // All three are read by engines on three.js.
    let intensity = Engine::Three.intensity(baked.quantity).map(|i| i * form.scale).ok_or_else(|| {
        Error::invalid(format!("gltf-lightmap-ext {}", extension.name()), "radiosity fits no lightmap slot")
    })?;
    let placed = placed(doc, extension, warnings)?;
    let textures = push_textures(doc, form);
    match extension {
        LightmapExtension::Moz => write_moz(doc, placed, &textures, intensity),
        LightmapExtension::Mx => write_mx(doc, placed, &textures, intensity),
        LightmapExtension::Needle => write_needle(doc, placed, &textures, warnings),
    }
}

/// Takes the extensions of an earlier bake out of the document: they would show its light, or keep its UVs.
pub fn strip(doc: &mut Document) {
    let lists = ["materials", "nodes"];
    for object in lists.into_iter().flat_map(|list| (0..doc.count(list)).map(move |i| (list, i))).collect::<Vec<_>>() {
        let Ok(object) = doc.item_mut(object.0, object.1) else { continue };
        let Some(extensions) = object.get_mut("extensions").and_then(Value::as_object_mut) else { continue };
        let had = [MOZ, MX].map(|name| extensions.shift_remove(name).is_some());
        if had.contains(&true) && extensions.is_empty() {
            object.shift_remove("extensions");
        }
    }
    [MOZ, MX, NEEDLE].into_iter().for_each(|name| doc.drop_extension(name));
}

/// The nodes with a rectangle of this bake.
fn placed(doc: &Document, extension: LightmapExtension, warnings: &mut Warnings) -> Result<Vec<Placed>> {
    let mut all = Vec::new();
    for node in 0..doc.count("nodes") {
        let object = doc.item("nodes", node)?;
        let Some(lumel) = object.get("extras").and_then(|e| e.get("lumel")).and_then(Value::as_object) else {
            continue;
        };
        let (Some(tex_coord), Some(mesh)) = (index(lumel, "texCoord"), index(object, "mesh")) else { continue };
        if instances::are_in(doc, node)? {
            let name = object.get("name").and_then(Value::as_str).unwrap_or("a node");
            let message =
                format!("draws instances, of which each has its rectangle; {} has one a node", extension.name());
            warnings.add(name, message);
            continue;
        }
        let pair = |key: &str| -> Option<Vec2> {
            let values = lumel.get(key)?.as_array()?;
            Some(Vec2::new(values.first()?.as_f64()? as f32, values.get(1)?.as_f64()? as f32))
        };
        if let (Some(page), Some(scale), Some(offset)) = (index(lumel, "page"), pair("scale"), pair("offset")) {
            let placement = Placement { page: page as u32, scale, offset };
            all.push(Placed { node, mesh, tex_coord, placement });
        }
    }
    Ok(all)
}

/// A texture for each page, in page order.
fn push_textures(doc: &mut Document, form: &Encoded) -> Vec<usize> {
    let sampler =
        doc.push("samplers", json!({ "magFilter": LINEAR, "minFilter": LINEAR, "wrapS": CLAMP, "wrapT": CLAMP }));
    let is_hdr = form.encoding == Encoding::Hdr;
    if is_hdr {
        doc.use_extension(MOZ_RGBE);
    }
    let push = |uri: &String| {
        let image = doc.push("images", json!({ "uri": import::uri_of(uri), "mimeType": form.encoding.media_type() }));
        let mut texture = json!({ "sampler": sampler });
        if is_hdr {
            texture["extensions"] = json!({ MOZ_RGBE: { "source": image } });
        } else {
            texture["source"] = image.into();
        }
        doc.push("textures", texture)
    };
    form.uris.iter().map(push).collect()
}

/// The extensions of an object, made where they are missing.
fn extensions(object: &mut Object) -> &mut Object {
    let extensions = object.entry("extensions").or_insert_with(|| json!({}));
    if !extensions.is_object() {
        *extensions = json!({});
    }
    extensions.as_object_mut().expect("just made an object")
}

fn write_mx(doc: &mut Document, placed: Vec<Placed>, textures: &[usize], intensity: f32) -> Result<()> {
    for p in placed {
        let value = json!({
            "lightMapTexture": { "index": textures[p.placement.page as usize], "texCoord": p.tex_coord },
            "scale": numbers(&p.placement.scale.to_array()),
            "offset": numbers(&p.placement.offset.to_array()),
            "intensity": number(intensity),
        });
        extensions(doc.item_mut("nodes", p.node)?).insert(MX.into(), value);
        doc.use_extension(MX);
    }
    Ok(())
}

fn write_needle(doc: &mut Document, placed: Vec<Placed>, textures: &[usize], warnings: &mut Warnings) -> Result<()> {
    let entry = |(page, texture): (usize, &usize)| json!({ "type": 0, "index": page, "pointer": format!("/textures/{texture}") });
    let list: Vec<Value> = textures.iter().enumerate().map(entry).collect();
    extensions(doc.root_mut()).insert(NEEDLE.into(), json!({ "textures": list }));
    doc.use_extension(NEEDLE);
    for p in placed {
        let node = doc.item_mut("nodes", p.node)?;
        if p.tex_coord != 1 {
            let name = node.get("name").and_then(Value::as_str).unwrap_or("a node").to_string();
            warnings.add(
                name,
                format!("Needle Engine reads lightmaps by TEXCOORD_1, and these UVs are TEXCOORD_{}", p.tex_coord),
            );
        }
        let [x, y, z, w] = rectangle(&p.placement, Vertical::Up).map(number);
        let own =
            json!({ "lightmapIndex": p.placement.page, "lightmapScaleOffset": { "x": x, "y": y, "z": z, "w": w } });
        let components = extensions(node).entry(NEEDLE_COMPONENTS).or_insert_with(|| json!({}));
        let list = &mut components["builtin_components"];
        if !list.is_array() {
            *list = json!([]);
        }
        let list = list.as_array_mut().expect("just made an array");
        let is_renderer = |c: &&mut Value| c.get("name").is_some_and(|n| n == "MeshRenderer");
        let renderer = match list.iter_mut().find(is_renderer) {
            Some(renderer) => renderer,
            None => {
                list.push(json!({ "name": "MeshRenderer", "enabled": true }));
                list.last_mut().expect("just pushed")
            }
        };
        for (key, value) in own.as_object().into_iter().flatten() {
            renderer[key] = value.clone();
        }
        doc.use_extension(NEEDLE_COMPONENTS);
    }
    Ok(())
}

fn write_moz(doc: &mut Document, placed: Vec<Placed>, textures: &[usize], intensity: f32) -> Result<()> {
    let mut users: BTreeMap<usize, usize> = BTreeMap::new();
    for node in 0..doc.count("nodes") {
        extras::mesh_of(doc, node)?.into_iter().for_each(|mesh| *users.entry(mesh).or_default() += 1);
    }
    // Pages and UV sets by mesh; then each of these meshes is one node's own.
    let mut pages: BTreeMap<usize, (usize, usize)> = BTreeMap::new();
    for p in placed {
        let count = users.entry(p.mesh).or_default();
        let mesh = if *count > 1 {
            *count -= 1;
            let copy = Value::Object(doc.item("meshes", p.mesh)?.clone());
            doc.push("meshes", copy)
        } else {
            p.mesh
        };
        let set = write_page_uvs(doc, mesh, &p)?;
        pages.insert(mesh, (p.placement.page as usize, set));
        doc.item_mut("nodes", p.node)?.insert("mesh".into(), mesh.into());
        let own = Placement { page: p.placement.page, scale: Vec2::ONE, offset: Vec2::ZERO };
        extras::write_placement(doc, p.node, &own, set)?;
    }
    split_materials(doc, &pages, textures, intensity)
}

/// Turns the lightmap UVs of a mesh into those of the page; returns their set, which is another where a texture reads
/// the first.
fn write_page_uvs(doc: &mut Document, mesh: usize, p: &Placed) -> Result<usize> {
    let primitives: Vec<usize> = (0..primitive_count(doc, mesh)?).collect();
    let set_name = format!("TEXCOORD_{}", p.tex_coord);
    let mut set = p.tex_coord;
    for primitive in &primitives {
        let json = primitive_json(doc, mesh, *primitive)?;
        if engine::is_read(doc, json, p.tex_coord) {
            let names = json.get("attributes").and_then(Value::as_object).into_iter().flat_map(|a| a.keys());
            set = set.max(names.filter(|n| n.starts_with("TEXCOORD_")).count());
        }
    }
    // Primitives that share UVs go on sharing them.
    let mut turned: BTreeMap<usize, usize> = BTreeMap::new();
    for primitive in primitives {
        let attributes = primitive_json(doc, mesh, primitive)?.get("attributes").and_then(Value::as_object);
        let Some(source) = attributes.and_then(|a| index(a, &set_name)) else { continue };
        let accessor = match turned.get(&source) {
            Some(accessor) => *accessor,
            None => {
                let uvs = accessor::read(doc, source)?.pairs().ok_or_else(|| {
                    Error::invalid(&doc.place, format!("accessors[{source}] holds no UVs; export the file again"))
                })?;
                let on_page = |uv: [f32; 2]| (Vec2::from_array(uv) * p.placement.scale + p.placement.offset).to_array();
                let accessor = accessor::Elements::floats(uvs.into_iter().map(on_page)).push(doc);
                turned.insert(source, accessor);
                accessor
            }
        };
        let json = primitive_json_mut(doc, mesh, primitive)?;
        if let Some(attributes) = json.get_mut("attributes").and_then(Value::as_object_mut) {
            // Sets must be numbered without a gap.
            for n in p.tex_coord + 1..set {
                attributes.entry(format!("TEXCOORD_{n}")).or_insert(accessor.into());
            }
            attributes.insert(format!("TEXCOORD_{set}"), accessor.into());
        }
    }
    Ok(set)
}

fn primitive_count(doc: &Document, mesh: usize) -> Result<usize> {
    Ok(doc.item("meshes", mesh)?.get("primitives").and_then(Value::as_array).map_or(0, Vec::len))
}

/// Gives every material of the meshes in `pages` (mesh to page and UV set) its page: a material of its own for each use
/// that differs.
fn split_materials(
    doc: &mut Document,
    pages: &BTreeMap<usize, (usize, usize)>,
    textures: &[usize],
    intensity: f32,
) -> Result<()> {
    let mut uses: BTreeMap<usize, BTreeSet<Option<(usize, usize)>>> = BTreeMap::new();
    for mesh in 0..doc.count("meshes") {
        for primitive in 0..primitive_count(doc, mesh)? {
            for material in material_indices(primitive_json(doc, mesh, primitive)?) {
                uses.entry(material).or_default().insert(pages.get(&mesh).copied());
            }
        }
    }
    let mut made: BTreeMap<(Option<usize>, (usize, usize)), usize> = BTreeMap::new();
    let mut material_for =
        |doc: &mut Document, material: Option<usize>, (page, set): (usize, usize)| -> Result<usize> {
            if let Some(made) = made.get(&(material, (page, set))) {
                return Ok(*made);
            }
            let mut object = match material {
                Some(material) => doc.item("materials", material)?.clone(),
                None => Object::new(),
            };
            let lightmap = json!({ "index": textures[page], "texCoord": set, "intensity": number(intensity) });
            extensions(&mut object).insert(MOZ.into(), lightmap);
            doc.use_extension(MOZ);
            // The first of several uses keeps the material's place, unless something without a lightmap needs it as it
            // was.
            let first = material.filter(|m| uses.get(m).and_then(|u| u.first()) == Some(&Some((page, set))));
            let place = match first {
                Some(place) => {
                    *doc.item_mut("materials", place)? = object;
                    place
                }
                None => doc.push("materials", Value::Object(object)),
            };
            made.insert((material, (page, set)), place);
            Ok(place)
        };
    for (mesh, class) in pages {
        for primitive in 0..primitive_count(doc, *mesh)? {
            let json = primitive_json(doc, *mesh, primitive)?;
            let (own, all) = (index(json, "material"), material_indices(json));
            let own = material_for(doc, own, *class)?;
            let mut renamed = BTreeMap::new();
            for material in all {
                renamed.insert(material, material_for(doc, Some(material), *class)?);
            }
            let json = primitive_json_mut(doc, *mesh, primitive)?;
            json.insert("material".into(), own.into());
            let variants = json.get_mut("extensions").and_then(|e| e.get_mut("KHR_materials_variants"));
            let mappings = variants.and_then(|v| v.get_mut("mappings")).and_then(Value::as_array_mut);
            for mapping in mappings.into_iter().flatten().filter_map(Value::as_object_mut) {
                if let Some(place) = index(mapping, "material").and_then(|m| renamed.get(&m)) {
                    mapping.insert("material".into(), (*place).into());
                }
            }
        }
    }
    Ok(())
}
