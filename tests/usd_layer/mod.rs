//! Bakes over USD files, made up in memory, whose layers tests write and open again.
#![allow(dead_code)] // each test file uses its own share

use glam::{Affine3A, Vec2, Vec3};
use lumel::load::{Source, usd::UsdSource};
use lumel::meshing::{LitMesh, VertexLight};
use lumel::post::Quantity;
use lumel::scene::{Material, Mesh, Scene, Surface, SurfaceOrigin, TriangleOrigin};
use lumel::unwrap::{Atlas, MeshUvs, Placement};
use lumel::write::{Baked, BakedLights, usd};
use openusd::gf::{Vec2f, Vec4f};
use openusd::sdf::FromValue;
use openusd::tf::Token;
use openusd::usd::{Prim, Stage};
use std::fs;
use std::path::PathBuf;

/// A bake of `usda` in a folder of its own.
pub struct Bake {
    pub folder: PathBuf,
    pub scene: Scene,
    pub atlas: Atlas,
    pub vertices: VertexLight,
    pub lights: BakedLights,
    pub quantity: Quantity,
}

pub const PAGES: [&str; 2] = ["lightmaps/room_0.exr", "lightmaps/room_1.exr"];

impl Bake {
    /// `test` names the folder.
    pub fn new(test: &str, usda: &str) -> Self {
        let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("write_usd").join(test);
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(folder.join("room_baked/lightmaps")).unwrap();
        fs::write(folder.join("room.usda"), usda).unwrap();
        for page in PAGES {
            fs::write(folder.join("room_baked").join(page), "").unwrap();
        }
        Self {
            folder,
            scene: Scene { materials: vec![Material::default()], ..Scene::default() },
            atlas: Atlas {
                pages: vec![[64, 64]; 2],
                meshes: Vec::new(),
                placements: Vec::new(),
                density: 1.0,
                padding: 2,
                shown_pages: 2,
            },
            vertices: VertexLight::default(),
            lights: BakedLights::Mark,
            quantity: Quantity::Outgoing,
        }
    }

    /// Adds a mesh of `counts` and `indices` (USD's face-varying topology), without the faces `left_out`. A corner's UV is
    /// (corner / 8, 0.25), v down.
    pub fn mesh(&mut self, counts: &[usize], left_out: &[usize]) -> usize {
        let mut mesh = Mesh::default();
        let mut uvs = MeshUvs { chart_count: 1, ..MeshUvs::default() };
        let mut first = 0;
        for (face, &count) in counts.iter().enumerate() {
            for k in 1..count - 1 {
                if left_out.contains(&face) {
                    continue;
                }
                let corners = [first, first + k, first + k + 1].map(|c| c as u32);
                mesh.triangles.push(corners);
                mesh.triangle_material.push(0);
                mesh.origin.push(TriangleOrigin { part: 0, face: face as u32, corners });
                uvs.corners.push(corners.map(|c| Vec2::new(c as f32 / 8.0, 0.25)));
                uvs.chart.push(0);
            }
            first += count;
        }
        mesh.positions = vec![Vec3::ZERO; first];
        self.scene.meshes.push(mesh);
        self.atlas.meshes.push(uvs);
        self.scene.meshes.len() - 1
    }

    /// Adds a surface whose rectangle is a quarter of `page`, `offset` from its top left, all of one colour.
    pub fn surface(&mut self, name: &str, mesh: usize, origin: SurfaceOrigin, page: u32, offset: [f32; 2]) {
        let world_from_local = Affine3A::IDENTITY;
        self.scene.surfaces.push(Surface {
            name: name.into(),
            mesh,
            world_from_local,
            origin,
            role: Default::default(),
        });
        self.atlas.placements.push(Placement { page, scale: Vec2::new(0.5, 0.25), offset: Vec2::from(offset) });
        let color = Vec3::new(self.scene.surfaces.len() as f32, 0.5, 1e-6);
        let corners = vec![[color; 3]; self.scene.meshes[mesh].triangles.len()];
        self.vertices.surfaces.push(LitMesh::given(corners));
    }

    pub fn instance(&mut self, root: &str, prim: &str, mesh: usize, page: u32, offset: [f32; 2]) {
        let origin = SurfaceOrigin::UsdInstance { root: root.into(), prim: prim.into() };
        self.surface(&format!("{root}/{prim}"), mesh, origin, page, offset);
    }

    pub fn point(&mut self, instancer: &str, index: usize, prim: &str, mesh: usize, page: u32, offset: [f32; 2]) {
        let origin = SurfaceOrigin::UsdPoint { instancer: instancer.into(), index, prim: prim.into() };
        self.surface(&format!("{instancer}[{index}]{prim}"), mesh, origin, page, offset);
    }

    pub fn input(&self) -> PathBuf {
        self.folder.join("room.usda")
    }

    pub fn output(&self) -> PathBuf {
        self.folder.join("room_baked/room.lumel.usda")
    }

    /// Writes the layer and gives its warnings' messages.
    pub fn try_write(&self) -> lumel::Result<Vec<String>> {
        let source = Source::Usd(UsdSource { path: self.input(), ..UsdSource::default() });
        let page_uris = PAGES.map(String::from);
        let baked = Baked {
            scene: &self.scene,
            source: &source,
            atlas: &self.atlas,
            lightmap: None,
            quantity: self.quantity,
            vertices: Some(&self.vertices),
            page_uris: &page_uris,
            encoded: &[],
            vertex_colors: Default::default(),
            lightmap_extension: None,
            folder: &self.folder.join("room_baked"),
            lights: self.lights,
        };
        let warnings = usd::write(&self.output(), &baked)?;
        Ok(warnings.iter().map(|w| format!("{}: {}", w.places[0], w.message)).collect())
    }

    /// Writes the layer and opens it.
    pub fn write(&self) -> (Stage, Vec<String>) {
        let warnings = self.try_write().unwrap();
        let registry = openusd_schemas::schema_registry();
        let stage = Stage::builder().schema_registry(registry).open(self.output().to_str().unwrap()).unwrap();
        let errors = stage.composition_errors();
        assert!(errors.is_empty(), "{errors:?}");
        (stage, warnings)
    }

    pub fn text(&self) -> String {
        fs::read_to_string(self.output()).unwrap()
    }
}

pub fn get<T: FromValue>(prim: &Prim, name: &str) -> Option<T>
where
    T::Error: Into<openusd::Error> + std::fmt::Debug,
{
    prim.attribute(name).get::<T>().unwrap()
}

pub fn interpolation(prim: &Prim, name: &str) -> String {
    prim.attribute(name).get_metadata::<Token>("interpolation").unwrap().unwrap().as_str().to_string()
}

/// A face-varying primvar's values, corner by corner.
pub fn flat(prim: &Prim, name: &str) -> Vec<[f32; 2]> {
    assert_eq!(interpolation(prim, name), "faceVarying");
    let values: Vec<Vec2f> = get(prim, name).unwrap();
    let indices: Vec<i32> = get(prim, &format!("{name}:indices")).unwrap();
    indices.iter().map(|&i| values[i as usize].into()).collect()
}

pub fn token(prim: &Prim, name: &str) -> Option<String> {
    get::<Token>(prim, name).map(|t| t.as_str().to_string())
}

pub fn rectangle(prim: &Prim, name: &str) -> Option<[f32; 4]> {
    get::<Vec4f>(prim, name).map(|v| [v.x, v.y, v.z, v.w])
}

/// A quad, a triangle and a hole over six points.
pub const MESH: &str = r#"
        int[] faceVertexCounts = [4, 3, 3]
        int[] faceVertexIndices = [0, 1, 2, 3, 2, 1, 4, 4, 5, 2]
        int[] holeIndices = [2]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0), (2, 1, 0)]
        uniform token subdivisionScheme = "none"
"#;
pub const COUNTS: [usize; 3] = [4, 3, 3];

pub fn room(body: &str) -> String {
    format!("#usda 1.0\n(\n    defaultPrim = \"World\"\n    upAxis = \"Y\"\n)\ndef Xform \"World\"\n{{\n{body}\n}}\n")
}

pub fn instance_of(name: &str, class: &str) -> String {
    format!("def Xform \"{name}\" (\n instanceable = true\n references = </{class}>\n)\n{{ }}\n")
}
