//! A Mesh in place of a gprim whose faces are not its own: an implicit shape, a subdivision surface that was refined, or a mesh that
//! was cut for the light.
//!
//! It stands at the same path, so transform, material, purpose and the rest of what is said about the prim still hold. It has
//! the triangles that were baked, their normals and UVs, and the material subsets cut to them. Primvars that vary over the
//! prim's own faces would no longer fit and are blocked; constant ones stay. It holds the surface as it was at the moment
//! of the bake, at every time.

use super::input::Input;
use super::layer::{Attribute, Layer, Prim as Opinions, array, tuple};
use super::primvars;
use crate::error::Warnings;
use crate::scene::{Mesh, TriangleOrigin};
use glam::Vec3;
use openusd::tf::Token;
use openusd::usd::Prim;
use std::collections::{BTreeMap, HashSet};
use std::fmt::Write as _;

/// Makes the prim at `site` of the layer, an opinion on `prim`, the Mesh `mesh`, as it can't hold what was baked.
pub fn author(prim: &Prim, mesh: &Mesh, site: &str, input: &Input, layer: &mut Layer, warnings: &mut Warnings) {
    let message =
        "can't hold lightmap UVs over faces of its own; in the layer a Mesh of the baked triangles takes its place";
    warnings.add(prim.path(), message);
    place(prim, mesh, true, site, input, layer, warnings);
}

/// Makes the prim at `site` of the layer, an opinion on `prim`, the Mesh `mesh`; `is_remade`: of faces that are not those of the
/// prim, or else of pieces of these.
pub fn place(
    prim: &Prim,
    mesh: &Mesh,
    is_remade: bool,
    site: &str,
    input: &Input,
    layer: &mut Layer,
    warnings: &mut Warnings,
) {
    let subsets = subsets(prim, mesh, is_remade, input);
    let blocked = blocked(prim, mesh);
    let lost: Vec<&str> = blocked.iter().map(String::as_str).filter(|name| *name != "normals").collect();
    if !lost.is_empty() {
        let message = "has primvars over faces that the Mesh in its place doesn't have; they were left out";
        warnings.add(format!("{} ({})", prim.path(), lost.join(", ")), message);
    }
    let has = |name: &str| prim.attribute(name).has_authored_value().unwrap_or(false);
    let (is_skinned, is_morphed) = (has("primvars:skel:jointIndices"), has("skel:blendShapes"));
    if is_skinned || is_morphed {
        warnings.add(prim.path(), "was refined in its pose: the Mesh in its place no longer moves with its skeleton");
    }
    let over = layer.prim(site);
    over.type_name = Some("Mesh");
    shape(over, mesh);
    // Of as many as the prim's own points.
    let of_points = [("vector3f[]", "velocities"), ("vector3f[]", "accelerations"), ("normal3f[]", "normals")];
    for (type_name, name) in of_points.into_iter().filter(|(_, name)| *name != "normals" || mesh.normals.is_empty()) {
        if has(name) {
            over.set(Attribute::of_schema(type_name, name, "None".into()));
        }
    }
    for name in blocked {
        let type_name = prim.attribute(format!("primvars:{name}")).type_name().ok().flatten();
        // Another type than the input's would be an error of its own.
        if let Some(type_name) = type_name.and_then(|t| known_type(t.as_str())) {
            over.set(Attribute::of_schema(type_name, format!("primvars:{name}"), "None".into()));
        }
    }
    if is_skinned {
        over.set(Attribute::of_schema("int[]", "primvars:skel:jointIndices", "None".into()));
        over.set(Attribute::of_schema("float[]", "primvars:skel:jointWeights", "None".into()));
    }
    if is_morphed {
        // Its blend shapes move points by number, and would move others.
        over.set(Attribute::of_schema("uniform token[]", "skel:blendShapes", "None".into()));
    }
    for (name, triangles) in subsets {
        let indices = array(&triangles, number);
        layer.prim(&format!("{site}/{name}")).set(Attribute::of_schema("int[]", "indices", indices));
    }
}

fn number(text: &mut String, value: &u32) {
    // Writing to a String does not fail.
    let _ = write!(text, "{value}");
}

/// Points, faces, normals and UVs.
fn shape(over: &mut Opinions, mesh: &Mesh) {
    let vectors = |values: &[Vec3]| array(values, |text, v| tuple(text, &v.to_array()));
    let indices: Vec<u32> = mesh.triangles.iter().flatten().copied().collect();
    let mut set = |type_name, name: &str, value| over.set(Attribute::of_schema(type_name, name, value));
    set("uniform token", "subdivisionScheme", "\"none\"".into());
    set("uniform token", "orientation", "\"rightHanded\"".into());
    set("point3f[]", "points", vectors(&mesh.positions));
    set("int[]", "faceVertexCounts", array(&vec![3; mesh.triangles.len()], number));
    set("int[]", "faceVertexIndices", array(&indices, number));
    set("int[]", "holeIndices", "[]".into());
    if let Some(bounds) = bounds(&mesh.positions) {
        set("float3[]", "extent", vectors(&bounds));
    }
    if !mesh.normals.is_empty() {
        let mut normals = Attribute::of_schema("normal3f[]", "normals", vectors(&mesh.normals));
        normals.interpolation = Some("vertex");
        over.set(normals);
    }
    for uvs in &mesh.uvs {
        let value = array(&uvs.coords, |text, uv| tuple(text, &[uv.x, 1.0 - uv.y]));
        over.set(Attribute::primvar("texCoord2f[]", &uvs.name, "vertex", value));
        over.set(primvars::indices(&uvs.name, "None".into()));
    }
    if !mesh.colors.is_empty() {
        let value = array(&mesh.colors, |text, c| tuple(text, &[c.x, c.y, c.z]));
        over.set(Attribute::primvar("color3f[]", "displayColor", "vertex", value));
        over.set(primvars::indices("displayColor", "None".into()));
    }
}

fn bounds(points: &[Vec3]) -> Option<[Vec3; 2]> {
    let first = *points.first()?;
    Some(points.iter().fold([first; 2], |[low, high], &p| [low.min(p), high.max(p)]))
}

/// Names of the primvars of `prim` that vary over its faces and that `mesh` says nothing about.
fn blocked(prim: &Prim, mesh: &Mesh) -> Vec<String> {
    let said: HashSet<&str> = mesh.uvs.iter().map(|set| set.name.as_str()).collect();
    let names = prim.authored_property_names().unwrap_or_default();
    let primvars = names.iter().filter_map(|name| name.strip_prefix("primvars:"));
    let varies = |name: &&str| {
        let attribute = prim.attribute(format!("primvars:{name}"));
        let interpolation = attribute.get_metadata::<Token>("interpolation").ok().flatten();
        interpolation.is_some_and(|i| i.as_str() != "constant")
    };
    let own = |name: &&str| {
        let is_color = *name == "displayColor" && !mesh.colors.is_empty();
        !name.ends_with(":indices")
            && !name.starts_with("skel:")
            && !name.starts_with("lumel:")
            && !said.contains(*name)
            && !is_color
    };
    primvars.filter(own).filter(varies).map(str::to_owned).collect()
}

/// The array types of USD, of which a primvar that varies has one.
fn known_type(name: &str) -> Option<&'static str> {
    const KNOWN: [&str; 53] = [
        "float[]",
        "float2[]",
        "float3[]",
        "float4[]",
        "double[]",
        "double2[]",
        "double3[]",
        "double4[]",
        "half[]",
        "half2[]",
        "half3[]",
        "half4[]",
        "int[]",
        "int2[]",
        "int3[]",
        "int4[]",
        "int64[]",
        "uint[]",
        "uint64[]",
        "uchar[]",
        "bool[]",
        "token[]",
        "string[]",
        "asset[]",
        "timecode[]",
        "color3f[]",
        "color3d[]",
        "color3h[]",
        "color4f[]",
        "color4d[]",
        "color4h[]",
        "normal3f[]",
        "normal3d[]",
        "normal3h[]",
        "point3f[]",
        "point3d[]",
        "point3h[]",
        "vector3f[]",
        "vector3d[]",
        "vector3h[]",
        "texCoord2f[]",
        "texCoord2d[]",
        "texCoord2h[]",
        "texCoord3f[]",
        "texCoord3d[]",
        "texCoord3h[]",
        "quatf[]",
        "quatd[]",
        "quath[]",
        "matrix2d[]",
        "matrix3d[]",
        "matrix4d[]",
        "frame4d[]",
    ];
    // What old files call them (SdfSchema's legacy types).
    const OLD: [(&str, &str); 20] = [
        ("Vec2i[]", "int2[]"),
        ("Vec3i[]", "int3[]"),
        ("Vec4i[]", "int4[]"),
        ("Vec2h[]", "half2[]"),
        ("Vec3h[]", "half3[]"),
        ("Vec4h[]", "half4[]"),
        ("Vec2f[]", "float2[]"),
        ("Vec3f[]", "float3[]"),
        ("Vec4f[]", "float4[]"),
        ("Vec2d[]", "double2[]"),
        ("Vec3d[]", "double3[]"),
        ("Vec4d[]", "double4[]"),
        ("PointFloat[]", "point3f[]"),
        ("Point[]", "point3d[]"),
        ("NormalFloat[]", "normal3f[]"),
        ("Normal[]", "normal3d[]"),
        ("VectorFloat[]", "vector3f[]"),
        ("Vector[]", "vector3d[]"),
        ("ColorFloat[]", "color3f[]"),
        ("Color[]", "color3d[]"),
    ];
    let name = OLD.iter().find(|(old, _)| *old == name).map_or(name, |(_, new)| new);
    KNOWN.into_iter().find(|known| *known == name)
}

/// The triangles of `mesh` that lie in the faces of each GeomSubset of `prim`.
fn subsets(prim: &Prim, mesh: &Mesh, is_remade: bool, input: &Input) -> BTreeMap<String, Vec<u32>> {
    let children = prim.children().unwrap_or_default();
    let subsets = children.iter().filter(|c| c.type_name().ok().flatten().is_some_and(|t| t == "GeomSubset"));
    let of_subset = |subset: &Prim| {
        let faces: Vec<i32> = input.value(&subset.attribute("indices")).unwrap_or_default();
        let faces: HashSet<u32> = faces.into_iter().filter_map(|f| u32::try_from(f).ok()).collect();
        let face = |origin: &TriangleOrigin| if is_remade { origin.part } else { origin.face };
        let triangles = mesh.origin.iter().enumerate().filter(|(_, origin)| faces.contains(&face(origin)));
        let name = subset.path().as_str().rsplit('/').next().unwrap_or_default().to_owned();
        (name, triangles.map(|(t, _)| t as u32).collect())
    };
    subsets.map(of_subset).collect()
}
