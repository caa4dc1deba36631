//! Sheets: triangles that let some of the light through, straight on, as cut-outs, blended surfaces and thin panes do.
//!
//! They lie in a tree of their own, so that rays through everything else go as if there were none. Where a ray meets sheets before
//! anything solid, all of its crossings with them are found in one traversal and taken in the order of (distance, number): sheets in
//! one plane need no tie-breaking offset, no ray is started anew, and no number of layers is too many.
//!
//! A sheet with opacity a and transmission t lets T = 1 - a + a t through (per channel). A way between two points is worth the product
//! of all T. A ray that looks for its nearest hit ends at a sheet by chance: one number, a hash of the ray, is compared to the mean of
//! the product so far, so that the ray ends at layer k with the chance `mean(T_1 .. T_k-1) - mean(T_1 .. T_k)`. What it stands for
//! is divided by that chance: a *tint*, white wherever all sheets on the way are grey. Stochastic transparency (Enderton et al. 2010)
//! with one number for all layers.

use super::Ray;
use super::traverse::{self, Line};
use super::wide::{WIDTH, Wide};
use crate::color::Rgb;
use crate::scene::material::{mean_share, passing};
use crate::scene::{Alpha, Material, Mesh, Scene, Texels, Texture, TextureSlot, Wrap};
use glam::{Vec2, Vec3, Vec4};
use std::collections::HashMap;

/// All sheets of a scene.
pub(super) struct Sheets {
    tree: Wide,
    /// In the order of their triangles' numbers.
    panes: Vec<Pane>,
    glasses: Vec<Glass>,
    maps: Vec<Map>,
    /// Whether any of them lets through one channel more than another.
    pub is_tinted: bool,
}

/// One triangle.
struct Pane {
    /// Its number over all surfaces.
    number: u32,
    surface: u32,
    glass: u32,
    is_mirrored: bool,
    /// Alpha of the vertex colours.
    alpha: [f32; 3],
    /// Image coordinates of the corners in the maps of opacity and of transmission.
    uv: [[Vec2; 3]; 2],
}

/// What sheets of one material do.
struct Glass {
    alpha: Alpha,
    opacity: Option<Look>,
    transmission: Rgb,
    transmission_map: Option<Look>,
}

/// How a map is read.
struct Look {
    map: usize,
    wrap: [Wrap; 2],
    scale: Vec4,
    bias: Vec4,
}

/// A texture as far as it is read here: of most the alpha alone.
enum Map {
    Alpha { size: [u32; 2], texels: Vec<u8> },
    Color(Texture),
}

/// A crossing with a sheet.
#[derive(Clone, Copy)]
struct Layer {
    /// Distance as it counts [m]: backs are farther by the origin offset.
    t: f32,
    pane: u32,
    /// Weights of corners 1 and 2 of the triangle as it stands in the tree.
    barycentric: [f32; 2],
    back: bool,
    /// Next to an edge, where the triangle beyond may be crossed too.
    on_edge: bool,
}

/// Corner weights below this are next to an edge.
const EDGE: f32 = 4.0 * f32::EPSILON;

/// Memory that crossings are sorted in.
pub(super) struct Layers {
    found: Vec<Layer>,
    stack: Vec<u64>,
}

/// Where a ray that met sheets goes.
pub(super) enum Passage {
    /// Past all of them, with this tint.
    On(Rgb),
    /// It ends at one: distance, number of the triangle, weights of its corners 1 and 2 (mesh order), whether on its back; and the tint.
    Ends(f32, u32, [f32; 2], bool, Rgb),
}

impl Sheets {
    /// The sheets among the triangles of `scene`: `place` tells surface and triangle of each, `corners` holds their corners [m], of which
    /// those of sheets are made no number, so that no other tree takes them. `None` where there are none.
    pub fn new(scene: &Scene, place: impl Fn(u32) -> (usize, usize), corners: &mut [[[f32; 3]; 3]]) -> Option<Self> {
        let clear: Vec<bool> = scene.materials.iter().map(|m| m.lets_light_through()).collect();
        if !clear.contains(&true) {
            return None;
        }
        let mut sheets = Self {
            tree: Wide { nodes: Vec::new(), blocks: Vec::new(), depth: 0 },
            panes: Vec::new(),
            glasses: Vec::new(),
            maps: Vec::new(),
            is_tinted: false,
        };
        let (mut glass_of, mut map_of, mut taken) = (HashMap::new(), HashMap::new(), Vec::new());
        for (number, corners) in (0..).zip(corners.iter_mut()) {
            let (surface, triangle) = place(number);
            let mesh = &scene.meshes[scene.surfaces[surface].mesh];
            let index = mesh.triangle_material[triangle];
            if !clear[index as usize] {
                continue;
            }
            let material = &scene.materials[index as usize];
            let glass = *glass_of.entry(index).or_insert_with(|| sheets.add_glass(scene, material, &mut map_of));
            let is_mirrored = scene.surfaces[surface].is_mirrored();
            let (alpha, uv) = looks(mesh, triangle, material);
            sheets.panes.push(Pane { number, surface: surface as u32, glass, is_mirrored, alpha, uv });
            taken.push(*corners);
            *corners = [[f32::NAN; 3]; 3];
        }
        sheets.tree = Wide::new(&taken);
        (!sheets.panes.is_empty()).then_some(sheets)
    }

    fn add_glass(&mut self, scene: &Scene, material: &Material, map_of: &mut HashMap<(usize, bool), usize>) -> u32 {
        let mut look = |slot: &TextureSlot, color: bool| {
            let map = *map_of.entry((slot.texture, color)).or_insert_with(|| {
                self.maps.push(Map::new(&scene.textures[slot.texture], color));
                self.maps.len() - 1
            });
            Look { map, wrap: slot.wrap, scale: slot.scale, bias: slot.bias }
        };
        let opacity = material.opacity_slot().map(|slot| look(slot, false));
        let transmission_map = material.transmission_texture.as_ref().map(|slot| look(slot, true));
        let [r, g, b] = material.transmission.to_array();
        self.is_tinted |= material.transmission != Rgb::ZERO && (transmission_map.is_some() || r != g || g != b);
        self.glasses.push(Glass {
            alpha: material.alpha,
            opacity,
            transmission: material.transmission,
            transmission_map,
        });
        self.glasses.len() as u32 - 1
    }

    /// Memory for crossings.
    pub fn layers(&self) -> Layers {
        Layers { found: Vec::new(), stack: vec![0; WIDTH * (self.tree.depth + 1)] }
    }

    /// Whether the sheets nearer than `hit` (distance and number; none: all) let the ray on.
    pub fn pass(&self, ray: &Ray, largest: f32, offset: f32, hit: Option<(f32, u32)>, layers: &mut Layers) -> Passage {
        let line = Line::new(ray.origin, ray.direction, largest);
        let limit = hit.map_or(f32::INFINITY, |h| h.0);
        self.cross(&line, limit, offset, layers);
        if let Some((t, number)) = hit {
            layers.found.retain(|l| (l.t, self.panes[l.pane as usize].number) < (t, number));
        }
        layers.found.sort_unstable_by(|a, b| a.t.total_cmp(&b.t).then(a.pane.cmp(&b.pane)));
        if layers.found.is_empty() {
            return Passage::On(Rgb::ONE);
        }
        let chance = chance(ray);
        let (mut product, mut left, mut grey) = (Rgb::ONE, 1.0f32, true);
        for layer in &layers.found {
            let passes = self.passes(layer);
            let next = product * passes;
            grey &= passes == Rgb::splat(passes.x);
            let mean = mean_share(next).min(left);
            if chance >= mean {
                let tint = if grey { Rgb::ONE } else { product * ((1.0 - mean_share(passes)) / (left - mean)) };
                let pane = &self.panes[layer.pane as usize];
                let barycentric = turned(layer.barycentric, pane.is_mirrored);
                return Passage::Ends(layer.t, pane.number, barycentric, layer.back, tint);
            }
            (product, left) = (next, mean);
        }
        Passage::On(if grey { Rgb::ONE } else { product / left })
    }

    /// What the sheets let through of light along a way of `length` [m].
    pub fn transmittance(&self, ray: &Ray, length: f32, largest: f32, offset: f32, layers: &mut Layers) -> Rgb {
        let line = Line::new(ray.origin, ray.direction, largest);
        self.cross(&line, length, offset, layers);
        layers.found.iter().fold(Rgb::ONE, |product, layer| product * self.passes(layer))
    }

    /// Finds the layers within `limit` [m], in the order of their triangles' numbers.
    fn cross(&self, line: &Line, limit: f32, offset: f32, layers: &mut Layers) {
        let Layers { found, stack } = layers;
        found.clear();
        traverse::crossings(&self.tree, line, limit, stack, |pane, crossing| {
            let t = if crossing.front { crossing.t } else { crossing.t + offset };
            if crossing.t <= limit {
                let [v, w] = crossing.barycentric;
                let on_edge = v.min(w).min(1.0 - v - w) < EDGE;
                found.push(Layer { t, pane, barycentric: [v, w], back: !crossing.front, on_edge });
            }
        });
        // Products of floats depend on the order.
        found.sort_unstable_by_key(|l| l.pane);
        if found.iter().filter(|l| l.on_edge).count() > 1 {
            self.join(found, offset);
        }
    }

    /// Takes what is crossed at the edges of several triangles of a surface, in one place, for one layer: that of the first.
    fn join(&self, found: &mut Vec<Layer>, offset: f32) {
        let mut kept: Vec<Layer> = Vec::with_capacity(found.len());
        for layer in found.iter().copied() {
            let surface = |l: &Layer| self.panes[l.pane as usize].surface;
            let is_same = |l: &Layer| l.on_edge && surface(l) == surface(&layer) && (l.t - layer.t).abs() <= offset;
            if !(layer.on_edge && kept.iter().any(is_same)) {
                kept.push(layer);
            }
        }
        *found = kept;
    }

    /// The share of light, by channel, that passes at a crossing.
    fn passes(&self, layer: &Layer) -> Rgb {
        let pane = &self.panes[layer.pane as usize];
        let glass = &self.glasses[pane.glass as usize];
        let [v, w] = turned(layer.barycentric, pane.is_mirrored);
        let at = |[a, b, c]: [Vec2; 3]| a + (b - a) * v + (c - a) * w;
        let texel = |look: &Option<Look>, k: usize| look.as_ref().map(|l| self.maps[l.map].read(l, at(pane.uv[k])));
        let [a, b, c] = pane.alpha;
        let vertex = a + (b - a) * v + (c - a) * w;
        let opacity = glass.alpha.share(texel(&glass.opacity, 0).map_or(1.0, |t| t.w) * vertex);
        let tint = texel(&glass.transmission_map, 1).map_or(Rgb::ONE, Vec4::truncate);
        passing(opacity, glass.transmission * tint)
    }
}

/// Corner weights in the order of the mesh, from those of the world's triangle, which is reversed where it is mirrored.
fn turned([v, w]: [f32; 2], is_mirrored: bool) -> [f32; 2] {
    if is_mirrored { [w, v] } else { [v, w] }
}

/// A triangle's alpha of the vertex colours, and its image coordinates in the maps of opacity and of transmission.
fn looks(mesh: &Mesh, triangle: usize, material: &Material) -> ([f32; 3], [[Vec2; 3]; 2]) {
    let corners = mesh.triangles[triangle];
    let alpha = if mesh.colors.is_empty() { [1.0; 3] } else { corners.map(|v| mesh.colors[v as usize].w) };
    let uv = [material.opacity_slot(), material.transmission_texture.as_ref()].map(|slot| {
        let set = slot.and_then(|slot| mesh.uv_set(&slot.uv_set).map(|uv| (slot, uv)));
        set.map_or([Vec2::ZERO; 3], |(slot, uv)| corners.map(|v| slot.image_from_uv.transform_point2(uv[v as usize])))
    });
    (alpha, uv)
}

impl Map {
    fn new(texture: &Texture, color: bool) -> Self {
        match &texture.texels {
            Texels::Srgb8(texels) | Texels::Linear8(texels) if !color => Self::Alpha {
                size: [texture.width, texture.height],
                texels: texels.iter().map(|texel| texel[3]).collect(),
            },
            _ => Self::Color(texture.clone()),
        }
    }

    fn read(&self, look: &Look, uv: Vec2) -> Vec4 {
        let texel = match self {
            Self::Alpha { size, texels } => Texture::bilinear(*size, uv, look.wrap, |x, y| {
                let alpha = texels[y as usize * size[0] as usize + x as usize];
                Vec3::ONE.extend(f32::from(alpha) / 255.0)
            }),
            Self::Color(texture) => texture.sample(uv, look.wrap),
        };
        texel * look.scale + look.bias
    }
}

/// A number in [0, 1) of a ray's own: a hash of its bits, by the finalizer of SplitMix64 (Steele, Lea, Flood 2014).
pub(super) fn chance(ray: &Ray) -> f32 {
    let bits = [ray.origin, ray.direction].map(|v| v.to_array().map(f32::to_bits));
    let mix = |key: u64, word: u32| {
        let z = (key ^ u64::from(word)).wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    };
    let hash = bits.as_flattened().iter().fold(0, |key, word| mix(key, *word));
    (hash >> 40) as f32 / (1u64 << 24) as f32
}
