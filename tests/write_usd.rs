//! The USD layer: written for scenes in memory over usda files, opened again with its sublayer.

use glam::{Affine3A, Vec2, Vec3};
use lumel::load::{self, LoadOptions, Source, usd::UsdSource};
use lumel::post::Quantity;
use lumel::post::vertex::CornerColors;
use lumel::scene::{
    Environment, Light, LightShape, Material, Mesh, Scene, Surface, SurfaceOrigin, TextureSlot, TriangleOrigin,
};
use lumel::unwrap::{Atlas, MeshUvs, Placement};
use lumel::write::{Baked, BakedLights, usd};
use openusd::gf::{Vec2f, Vec3f, Vec4f};
use openusd::sdf::{AssetPath, FromValue, Value};
use openusd::tf::Token;
use openusd::usd::{Prim, Stage};
use std::fs;
use std::path::{Path, PathBuf};

/// A bake of `usda` in a folder of its own.
struct Bake {
    folder: PathBuf,
    scene: Scene,
    atlas: Atlas,
    corners: CornerColors,
    lights: BakedLights,
    quantity: Quantity,
}

const PAGES: [&str; 2] = ["lightmaps/room_0.exr", "lightmaps/room_1.exr"];

impl Bake {
    /// `test` names the folder.
    fn new(test: &str, usda: &str) -> Self {
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
            corners: CornerColors { surfaces: Vec::new() },
            lights: BakedLights::Mark,
            quantity: Quantity::Outgoing,
        }
    }

    /// Adds a mesh of `counts` and `indices` (USD's face-varying topology), without the faces `left_out`. A corner's UV is
    /// (corner / 8, 0.25), v down.
    fn mesh(&mut self, counts: &[usize], left_out: &[usize]) -> usize {
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
    fn surface(&mut self, name: &str, mesh: usize, origin: SurfaceOrigin, page: u32, offset: [f32; 2]) {
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
        self.corners.surfaces.push(vec![[color; 3]; self.scene.meshes[mesh].triangles.len()]);
    }

    fn instance(&mut self, root: &str, prim: &str, mesh: usize, page: u32, offset: [f32; 2]) {
        let origin = SurfaceOrigin::UsdInstance { root: root.into(), prim: prim.into() };
        self.surface(&format!("{root}/{prim}"), mesh, origin, page, offset);
    }

    fn point(&mut self, instancer: &str, index: usize, prim: &str, mesh: usize, page: u32, offset: [f32; 2]) {
        let origin = SurfaceOrigin::UsdPoint { instancer: instancer.into(), index, prim: prim.into() };
        self.surface(&format!("{instancer}[{index}]{prim}"), mesh, origin, page, offset);
    }

    fn input(&self) -> PathBuf {
        self.folder.join("room.usda")
    }

    fn output(&self) -> PathBuf {
        self.folder.join("room_baked/room.lumel.usda")
    }

    /// Writes the layer and gives its warnings' messages.
    fn try_write(&self) -> lumel::Result<Vec<String>> {
        let source = Source::Usd(UsdSource { path: self.input(), ..UsdSource::default() });
        let page_uris = PAGES.map(String::from);
        let baked = Baked {
            scene: &self.scene,
            source: &source,
            atlas: &self.atlas,
            lightmap: None,
            quantity: self.quantity,
            corners: Some(&self.corners),
            page_uris: &page_uris,
            folder: &self.folder.join("room_baked"),
            lights: self.lights,
        };
        let warnings = usd::write(&self.output(), &baked)?;
        Ok(warnings.iter().map(|w| format!("{}: {}", w.places[0], w.message)).collect())
    }

    /// Writes the layer and opens it.
    fn write(&self) -> (Stage, Vec<String>) {
        let warnings = self.try_write().unwrap();
        let registry = openusd_schemas::schema_registry();
        let stage = Stage::builder().schema_registry(registry).open(self.output().to_str().unwrap()).unwrap();
        let errors = stage.composition_errors();
        assert!(errors.is_empty(), "{errors:?}");
        (stage, warnings)
    }

    fn text(&self) -> String {
        fs::read_to_string(self.output()).unwrap()
    }
}

fn get<T: FromValue>(prim: &Prim, name: &str) -> Option<T>
where
    T::Error: Into<openusd::Error> + std::fmt::Debug,
{
    prim.attribute(name).get::<T>().unwrap()
}

fn interpolation(prim: &Prim, name: &str) -> String {
    prim.attribute(name).get_metadata::<Token>("interpolation").unwrap().unwrap().as_str().to_string()
}

/// A face-varying primvar's values, corner by corner.
fn flat(prim: &Prim, name: &str) -> Vec<[f32; 2]> {
    assert_eq!(interpolation(prim, name), "faceVarying");
    let values: Vec<Vec2f> = get(prim, name).unwrap();
    let indices: Vec<i32> = get(prim, &format!("{name}:indices")).unwrap();
    indices.iter().map(|&i| values[i as usize].into()).collect()
}

fn token(prim: &Prim, name: &str) -> Option<String> {
    get::<Token>(prim, name).map(|t| t.as_str().to_string())
}

fn rectangle(prim: &Prim, name: &str) -> Option<[f32; 4]> {
    get::<Vec4f>(prim, name).map(|v| [v.x, v.y, v.z, v.w])
}

/// A quad, a triangle and a hole over six points.
const MESH: &str = r#"
        int[] faceVertexCounts = [4, 3, 3]
        int[] faceVertexIndices = [0, 1, 2, 3, 2, 1, 4, 4, 5, 2]
        int[] holeIndices = [2]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0), (2, 1, 0)]
        uniform token subdivisionScheme = "none"
"#;
const COUNTS: [usize; 3] = [4, 3, 3];

fn room(body: &str) -> String {
    format!("#usda 1.0\n(\n    defaultPrim = \"World\"\n    upAxis = \"Y\"\n)\ndef Xform \"World\"\n{{\n{body}\n}}\n")
}

#[test]
fn gprims_get_uvs_rectangle_page_and_colours() {
    let usda = room(&format!("def Mesh \"Box\"\n{{{MESH}}}\ndef Mesh \"Lid\"\n{{{MESH}}}"));
    let mut bake = Bake::new("gprims", &usda);
    let mesh = bake.mesh(&COUNTS, &[2]);
    bake.surface("/World/Box", mesh, SurfaceOrigin::UsdPrim, 0, [0.125, 0.5]);
    bake.surface("/World/Lid", mesh, SurfaceOrigin::UsdPrim, 1, [0.0, 0.0]);
    // The lid's two faces disagree at the points that they share.
    bake.corners.surfaces[1][2] = [Vec3::splat(7.0); 3];
    let (stage, warnings) = bake.write();
    assert_eq!(warnings, [""; 0]);
    assert_eq!(fs::read_to_string(bake.input()).unwrap(), usda);

    let prim = stage.prim("/World/Box").unwrap();
    let uvs = flat(&prim, "primvars:st1");
    let expected: Vec<[f32; 2]> = (0..10).map(|c| if c < 7 { [c as f32 / 8.0, 0.75] } else { [0.0, 0.0] }).collect();
    assert_eq!(uvs, expected);
    assert_eq!(prim.attribute("primvars:st1").type_name().unwrap().unwrap().as_str(), "texCoord2f[]");
    assert_eq!(token(&prim, "lumel:uvName").unwrap(), "st1");
    assert_eq!(token(&prim, "lumel:quantity").unwrap(), "outgoing");
    // v down, 0.25 becomes 0.25 * 0.25 + 0.5; v up the same point is 0.75, and must become 1 - 0.5625.
    assert_eq!(rectangle(&prim, "primvars:lumel:scaleOffset"), Some([0.5, 0.25, 0.125, 0.25]));
    assert_eq!(0.75 * 0.25 + 0.25, 1.0 - 0.5625);
    assert_eq!(interpolation(&prim, "primvars:lumel:scaleOffset"), "constant");
    let page: AssetPath = get(&prim, "lumel:lightmap").unwrap();
    assert_eq!(page.as_str(), "./lightmaps/room_0.exr");
    assert!(page.resolved_path().unwrap().ends_with("room_baked/lightmaps/room_0.exr"));

    for name in ["primvars:displayColor", "primvars:lumel:irradiance"] {
        assert_eq!(interpolation(&prim, name), "vertex");
        let colors: Vec<Vec3f> = get(&prim, name).unwrap();
        let lit = Vec3f { x: 1.0, y: 0.5, z: 1e-6 };
        assert_eq!(colors, [lit, lit, lit, lit, lit, Vec3f { x: 0.0, y: 0.0, z: 0.0 }]);
    }
    let lid = stage.prim("/World/Lid").unwrap();
    assert_eq!(interpolation(&lid, "primvars:displayColor"), "faceVarying");
    let indices: Vec<i32> = get(&lid, "primvars:displayColor:indices").unwrap();
    assert_eq!(indices, [0, 0, 0, 0, 1, 1, 1, 2, 2, 2]);
    let page: AssetPath = get(&lid, "lumel:lightmap").unwrap();
    assert_eq!(page.as_str(), "./lightmaps/room_1.exr");

    // Equal input, equal bytes.
    let first = bake.text();
    bake.write();
    assert_eq!(bake.text(), first);
}

#[test]
fn metadata_is_that_of_the_input() {
    let usda = r#"#usda 1.0
(
    "a comment that is about the input alone"
    customLayerData = {
        asset icon = @./icon.png@
        string author = "she said \"hello\""
        dictionary "render settings" = {
            double "rtx:light:intensity" = 0.5
        }
    }
    colorConfiguration = @./ocio/config.ocio@
    defaultPrim = "World"
    endTimeCode = 48
    framesPerSecond = 30
    kilogramsPerUnit = 0.001
    metersPerUnit = 0.0254
    startTimeCode = 1
    subLayers = [@./sub.usda@]
    timeCodesPerSecond = 60
    upAxis = "Z"
)
def Xform "World" { }
"#;
    let mut bake = Bake::new("metadata", usda);
    fs::write(bake.folder.join("sub.usda"), "#usda 1.0\n(\n upAxis = \"Y\"\n)\n").unwrap();
    bake.quantity = Quantity::Irradiance;
    let (stage, _) = bake.write();
    let number = |name: &str| match stage.stage_metadata(name).unwrap() {
        Some(Value::Double(v)) => v,
        other => panic!("{name}: {other:?}"),
    };
    assert_eq!(number("metersPerUnit"), 0.0254);
    assert_eq!(number("kilogramsPerUnit"), 0.001);
    assert_eq!((stage.start_time_code(), stage.end_time_code()), (1.0, 48.0));
    assert_eq!((stage.time_codes_per_second(), stage.frames_per_second()), (60.0, 30.0));
    assert_eq!(stage.default_prim().unwrap().as_str(), "World");
    assert_eq!(stage.stage_metadata("upAxis").unwrap(), Some(Value::token("Z")));
    let text = bake.text();
    assert!(text.contains("colorConfiguration = @../ocio/config.ocio@"), "{text}");
    assert!(text.contains("subLayers = [@../room.usda@]"), "{text}");
    assert!(!text.contains("a comment"), "{text}");
    let Some(Value::Dictionary(data)) = stage.custom_layer_data().unwrap() else { panic!("no customLayerData") };
    assert_eq!(data["icon"], Value::AssetPath("../icon.png".into()));
    assert_eq!(data["author"], Value::String("she said \"hello\"".into()));
    let Value::Dictionary(settings) = &data["render settings"] else { panic!("no settings") };
    assert_eq!(settings["rtx:light:intensity"], Value::Double(0.5));
    assert!(text.contains("double \"rtx:light:intensity\" = 0.5"), "usd-core reads no bare key with a colon: {text}");
    let Value::Dictionary(lumel) = &data["lumel"] else { panic!("no lumel") };
    assert_eq!(lumel["version"], Value::String(env!("CARGO_PKG_VERSION").into()));
    assert_eq!(lumel["quantity"], Value::String("irradiance".into()));
    assert_eq!(lumel["unit"], Value::String("lx".into()));
    assert_eq!(lumel["pages"], Value::AssetPathVec(PAGES.map(|p| format!("./{p}").into()).into()));
}

#[test]
fn uvs_avoid_a_name_that_a_texture_reads() {
    let shader = r#"
    def Material "Paint"
    {
        def Shader "Uvs"
        {
            uniform token info:id = "UsdPrimvarReader_float2"
            string inputs:varname = "st2"
        }
    }"#;
    let mut bake = Bake::new("names", &room(&format!("def Mesh \"Box\"\n{{{MESH}}}\n{shader}")));
    let mesh = bake.mesh(&COUNTS, &[]);
    bake.surface("/World/Box", mesh, SurfaceOrigin::UsdPrim, 0, [0.0; 2]);
    // One is read by a texture of the scene, one by a shader that the scene doesn't know.
    bake.scene.materials[0].albedo_texture = Some(TextureSlot::new(0, "st1"));
    let (stage, warnings) = bake.write();
    let prim = stage.prim("/World/Box").unwrap();
    assert_eq!(flat(&prim, "primvars:st3").len(), 10);
    assert_eq!(token(&prim, "lumel:uvName").unwrap(), "st3");
    assert!(warnings[0].starts_with("st3: "), "{warnings:?}");
}

#[test]
fn authored_uvs_are_named_and_not_written_again() {
    let uvs = "texCoord2f[] primvars:lightmap = [(0, 0)] (\n interpolation = \"constant\"\n)\n";
    let mut bake = Bake::new("authored", &room(&format!("def Mesh \"Box\"\n{{{MESH}{uvs}}}")));
    let mesh = bake.mesh(&COUNTS, &[]);
    bake.atlas.meshes[mesh].authored = Some("lightmap".into());
    bake.surface("/World/Box", mesh, SurfaceOrigin::UsdPrim, 0, [0.0; 2]);
    let (stage, _) = bake.write();
    let prim = stage.prim("/World/Box").unwrap();
    assert_eq!(token(&prim, "lumel:uvName").unwrap(), "lightmap");
    assert!(!bake.text().contains("st1"));
    assert!(rectangle(&prim, "primvars:lumel:scaleOffset").is_some());
}

#[test]
fn display_color_stays_where_the_look_depends_on_it() {
    let material = r#"
    def Material "Reads"
    {
        token outputs:surface.connect = </World/Reads/Color.outputs:result>
        def Shader "Color"
        {
            uniform token info:id = "UsdPrimvarReader_float3"
            string inputs:varname = "displayColor"
            float3 outputs:result
        }
    }
    def Material "Plain" { }"#;
    let red = "color3f[] primvars:displayColor = [(1, 0, 0)]\n int[] primvars:displayColor:indices = [0]\n";
    let prim = |name: &str, rest: &str| format!("def Mesh \"{name}\"\n{{{MESH}{rest}}}\n");
    let meshes = [
        prim("Bound", "rel material:binding = </World/Reads>\n"),
        prim("Unbound", red),
        prim("Covered", &format!("{red}rel material:binding = </World/Plain>\n")),
        prim("Subset", "def GeomSubset \"Part\"\n{\nrel material:binding = </World/Reads>\n}\n"),
    ];
    let mut bake = Bake::new("display_color", &room(&format!("{material}\n{}", meshes.concat())));
    let mesh = bake.mesh(&COUNTS, &[]);
    for name in ["Bound", "Unbound", "Covered", "Subset"] {
        bake.surface(&format!("/World/{name}"), mesh, SurfaceOrigin::UsdPrim, 0, [0.0; 2]);
    }
    let (stage, warnings) = bake.write();
    let colors =
        |name: &str| get::<Vec<Vec3f>>(&stage.prim(format!("/World/{name}")).unwrap(), "primvars:displayColor");
    assert_eq!(colors("Bound"), None);
    assert_eq!(colors("Unbound").unwrap(), [Vec3f { x: 1.0, y: 0.0, z: 0.0 }]);
    assert_eq!(colors("Covered").unwrap().len(), 6);
    assert_eq!(colors("Subset"), None);
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    // The input's indices are for one value, not for ours.
    let covered = stage.prim("/World/Covered").unwrap();
    assert_eq!(get::<Vec<i32>>(&covered, "primvars:displayColor:indices"), None);
}

/// Three chairs that are instances of one prototype, each with a seat and a back.
fn chairs() -> String {
    let chair =
        |name: &str| format!("def Xform \"{name}\" (\n instanceable = true\n references = </Chair>\n)\n{{ }}\n");
    let room = room(&["One", "Two", "Three"].map(chair).concat());
    let parts = format!("def Mesh \"Seat\"\n{{{MESH}}}\ndef Scope \"Geom\"\n{{\ndef Mesh \"Back\"\n{{{MESH}}}\n}}");
    format!("{room}\nclass Xform \"Chair\"\n{{\n{parts}\n}}\n")
}

#[test]
fn instances_stay_instances_of_one_prototype() {
    let mut bake = Bake::new("instances", &chairs());
    let (seat, back) = (bake.mesh(&COUNTS, &[]), bake.mesh(&COUNTS, &[2]));
    bake.instance("/World/One", "Seat", seat, 0, [0.0, 0.0]);
    bake.instance("/World/One", "Geom/Back", back, 1, [0.0, 0.5]);
    bake.instance("/World/Two", "Seat", seat, 0, [0.5, 0.25]);
    bake.instance("/World/Two", "Geom/Back", back, 0, [0.25, 0.25]);
    let (stage, warnings) = bake.write();
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    let names = ["One", "Two", "Three"].map(|n| stage.prim(format!("/World/{n}")).unwrap());
    assert!(names.iter().all(|p| p.is_instance().unwrap()));
    let prototypes = names.clone().map(|p| p.prototype().unwrap().unwrap());
    assert!(prototypes.iter().all(|p| *p == prototypes[0]), "{prototypes:?}");

    for instance in ["One", "Two", "Three"] {
        let seat = stage.prim(format!("/World/{instance}/Seat")).unwrap();
        let back = stage.prim(format!("/World/{instance}/Geom/Back")).unwrap();
        assert_eq!(flat(&seat, "primvars:st1")[9], [9.0 / 8.0, 0.75]);
        assert_eq!(flat(&back, "primvars:st1")[9], [0.0, 0.0]);
        assert_eq!(get::<Vec<Vec3f>>(&seat, "primvars:displayColor"), None);
    }
    let [one, two, three] = names;
    assert_eq!(rectangle(&one, "primvars:lumel:scaleOffset:Seat"), Some([0.5, 0.25, 0.0, 0.75]));
    assert_eq!(rectangle(&two, "primvars:lumel:scaleOffset:Seat"), Some([0.5, 0.25, 0.5, 0.5]));
    assert_eq!(rectangle(&two, "primvars:lumel:scaleOffset:Geom:Back"), Some([0.5, 0.25, 0.25, 0.5]));
    assert_eq!(rectangle(&three, "primvars:lumel:scaleOffset:Seat"), None);
    let page = |name: &str| get::<AssetPath>(&one, name).unwrap().as_str().to_string();
    assert_eq!(page("lumel:lightmap:Seat"), "./lightmaps/room_0.exr");
    assert_eq!(page("lumel:lightmap:Geom:Back"), "./lightmaps/room_1.exr");
}

#[test]
fn instances_of_one_gprim_have_a_plain_rectangle() {
    let mut bake = Bake::new("instances_plain", &chairs());
    let seat = bake.mesh(&COUNTS, &[]);
    bake.instance("/World/One", "Seat", seat, 0, [0.0, 0.0]);
    bake.instance("/World/Three", "Seat", seat, 1, [0.0, 0.5]);
    let (stage, _) = bake.write();
    let three = stage.prim("/World/Three").unwrap();
    assert_eq!(rectangle(&three, "primvars:lumel:scaleOffset"), Some([0.5, 0.25, 0.0, 0.25]));
    assert_eq!(get::<AssetPath>(&three, "lumel:lightmap").unwrap().as_str(), "./lightmaps/room_1.exr");
    assert_eq!(token(&three, "lumel:quantity").unwrap(), "outgoing");
}

#[test]
fn instances_of_different_uvs_get_classes_of_their_own() {
    let mut bake = Bake::new("instances_differ", &chairs());
    let (seat, other) = (bake.mesh(&COUNTS, &[]), bake.mesh(&COUNTS, &[2]));
    bake.instance("/World/One", "Seat", seat, 0, [0.0, 0.0]);
    bake.instance("/World/Two", "Seat", other, 0, [0.0, 0.5]);
    let (stage, _) = bake.write();
    let last = |name: &str| flat(&stage.prim(format!("/World/{name}/Seat")).unwrap(), "primvars:st1")[9];
    assert_eq!((last("One"), last("Two"), last("Three")), ([1.125, 0.75], [0.0, 0.0], [1.125, 0.75]));
    assert!(stage.prim("/World/Two").unwrap().is_instance().unwrap());
}

/// Two sets that are instances of one prototype, which holds two instances of another.
fn sets() -> String {
    format!(
        "{}\nclass Xform \"Set\"\n{{\n{}\n}}\nclass Xform \"Leg\"\n{{\ndef Mesh \"Bar\"\n{{{MESH}}}\n}}\n",
        room(&["A", "B"].map(|n| instance_of(n, "Set")).concat()),
        ["Left", "Right"].map(|n| instance_of(n, "Leg")).concat(),
    )
}

#[test]
fn nested_instances_hold_uvs() {
    let mut bake = Bake::new("instances_nested", &sets());
    let bar = bake.mesh(&COUNTS, &[]);
    let mut x = 0.0;
    for root in ["/World/A", "/World/B"] {
        for leg in ["Left", "Right"] {
            bake.instance(root, &format!("{leg}/Bar"), bar, 0, [x, 0.0]);
            x += 0.125;
        }
    }
    let (stage, _) = bake.write();
    for (root, x) in [("/World/A", 0.0), ("/World/B", 0.25)] {
        let instance = stage.prim(root).unwrap();
        assert!(instance.is_instance().unwrap());
        assert_eq!(rectangle(&instance, "primvars:lumel:scaleOffset:Right:Bar"), Some([0.5, 0.25, x + 0.125, 0.75]));
        for leg in ["Left", "Right"] {
            assert!(stage.prim(format!("{root}/{leg}")).unwrap().is_instance().unwrap());
            let bar = stage.prim(format!("{root}/{leg}/Bar")).unwrap();
            assert_eq!(flat(&bar, "primvars:st1")[3], [0.375, 0.75]);
        }
    }
}

fn instance_of(name: &str, class: &str) -> String {
    format!("def Xform \"{name}\" (\n instanceable = true\n references = </{class}>\n)\n{{ }}\n")
}

/// An instancer of four points, the second of them hidden, and two prototypes of which one has two gprims.
fn trees() -> String {
    let tree = format!("def Mesh \"Trunk\"\n{{{MESH}}}\ndef Mesh \"Crown\"\n{{{MESH}}}\n");
    room(&format!(
        "def PointInstancer \"Trees\"
        {{
            rel prototypes = [</World/Trees/Kinds/Tree>, </World/Trees/Kinds/Bush>]
            int[] protoIndices = [0, 1, 1, 1]
            point3f[] positions = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)]
            int64[] invisibleIds = [1]
            def Scope \"Kinds\"
            {{
                def Xform \"Tree\"\n{{\n{tree}}}
                def Mesh \"Bush\"\n{{{MESH}}}
            }}
        }}"
    ))
}

#[test]
fn point_instancers_have_a_rectangle_for_each_point() {
    let kinds = "/World/Trees/Kinds";
    let mut bake = Bake::new("points", &trees());
    let bush = bake.mesh(&COUNTS, &[]);
    bake.point("/World/Trees", 2, &format!("{kinds}/Bush"), bush, 0, [0.0, 0.0]);
    bake.point("/World/Trees", 3, &format!("{kinds}/Bush"), bush, 1, [0.5, 0.0]);
    let (stage, warnings) = bake.write();
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    let instancer = stage.prim("/World/Trees").unwrap();
    let none = Vec4f { x: 0.0, y: 0.0, z: 0.0, w: 0.0 };
    let rectangles: Vec<Vec4f> = get(&instancer, "primvars:lumel:scaleOffset").unwrap();
    let at = |x: f32| Vec4f { x: 0.5, y: 0.25, z: x, w: 0.75 };
    assert_eq!(rectangles, [none, none, at(0.0), at(0.5)]);
    assert_eq!(interpolation(&instancer, "primvars:lumel:scaleOffset"), "vertex");
    assert_eq!(get::<Vec<i32>>(&instancer, "primvars:lumel:page").unwrap(), [-1, -1, 0, 1]);
    assert_eq!(get::<Vec<AssetPath>>(&instancer, "lumel:lightmaps").unwrap().len(), 2);
    let bush = stage.prim(format!("{kinds}/Bush")).unwrap();
    assert_eq!(flat(&bush, "primvars:st1")[2], [0.25, 0.75]);
    assert_eq!(rectangle(&bush, "primvars:lumel:scaleOffset"), None);
}

#[test]
fn prototypes_of_several_gprims_name_their_rectangles() {
    let kinds = "/World/Trees/Kinds";
    let mut bake = Bake::new("points_many", &trees());
    let mesh = bake.mesh(&COUNTS, &[]);
    bake.point("/World/Trees", 0, &format!("{kinds}/Tree/Trunk"), mesh, 0, [0.0, 0.0]);
    bake.point("/World/Trees", 0, &format!("{kinds}/Tree/Crown"), mesh, 1, [0.25, 0.0]);
    let (stage, _) = bake.write();
    let instancer = stage.prim("/World/Trees").unwrap();
    let crown = "World:Trees:Kinds:Tree:Crown";
    let pages: Vec<i32> = get(&instancer, &format!("primvars:lumel:page:{crown}")).unwrap();
    assert_eq!(pages, [1, -1, -1, -1]);
    let rectangles: Vec<Vec4f> = get(&instancer, &format!("primvars:lumel:scaleOffset:{crown}")).unwrap();
    assert_eq!(rectangles[0].z, 0.25);
}

#[test]
fn lights_are_marked_removed_or_kept() {
    let lights = "def RectLight \"Lamp\"\n{\n}\ndef DomeLight \"Sky\"\n{\n}";
    let lamp = format!("{}class Xform \"Lantern\"\n{{\ndef SphereLight \"Bulb\"\n{{\n}}\n}}\n", {
        room(&format!("{lights}\n{}", ["Left", "Right"].map(|n| instance_of(n, "Lantern")).concat()))
    });
    let mut bake = Bake::new("lights", &lamp);
    for name in ["/World/Lamp", "/World/Left/Bulb", "/World/Gone", "not a path"] {
        let shape = LightShape::Point { position: Vec3::ZERO, intensity: Vec3::ONE, range: None };
        bake.scene.lights.push(Light::new(name, shape));
    }
    bake.scene.environment = Some(Environment::constant("/World/Sky", Vec3::ONE));
    let (stage, warnings) = bake.write();
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    let baked = |path: &str| get::<bool>(&stage.prim(path).unwrap(), "lumel:baked");
    for path in ["/World/Lamp", "/World/Sky", "/World/Left/Bulb", "/World/Right/Bulb"] {
        assert_eq!(baked(path), Some(true), "{path}");
    }
    assert!(stage.prim("/World/Left").unwrap().is_instance().unwrap());

    bake.lights = BakedLights::Remove;
    let (stage, _) = bake.write();
    for path in ["/World/Lamp", "/World/Sky", "/World/Left/Bulb"] {
        assert!(!stage.prim(path).unwrap().is_active().unwrap(), "{path}");
    }
    bake.lights = BakedLights::Keep;
    bake.scene.environment = Some(Environment::constant("--sky", Vec3::ONE));
    bake.write();
    assert!(!bake.text().contains("over"));
}

#[test]
fn what_the_stage_does_not_hold_is_a_warning() {
    let mut bake = Bake::new("missing", &room(&format!("def Cube \"Cube\"\n{{\n}}\ndef Mesh \"Box\"\n{{{MESH}}}")));
    let mesh = bake.mesh(&COUNTS, &[]);
    let larger = bake.mesh(&[4, 4, 4], &[]);
    bake.surface("/World/Cube", mesh, SurfaceOrigin::UsdPrim, 0, [0.0; 2]);
    bake.surface("/World/Gone", mesh, SurfaceOrigin::UsdPrim, 0, [0.0; 2]);
    bake.surface("no path", mesh, SurfaceOrigin::UsdPrim, 0, [0.0; 2]);
    bake.surface("", mesh, SurfaceOrigin::UsdPrim, 0, [0.0; 2]);
    bake.surface("/World/Box", larger, SurfaceOrigin::UsdPrim, 0, [0.0; 2]);
    bake.point("/World/Nobody", usize::MAX, "/World/Box", mesh, 0, [0.0; 2]);
    bake.point("/World", usize::MAX, "/World/Box", mesh, 0, [0.0; 2]);
    let (_, warnings) = bake.write();
    assert!(warnings.len() >= 4, "{warnings:?}");

    fs::write(bake.input(), "#usda 1.0\ndef {{{").unwrap();
    let error = bake.try_write().unwrap_err().to_string();
    assert!(error.contains("room.usda"), "{error}");
    fs::remove_file(bake.input()).unwrap();
    assert!(bake.try_write().is_err());
}

#[test]
fn a_bake_of_a_bake_writes_its_own_colours_again() {
    let mut bake = Bake::new("again", &room(&format!("def Mesh \"Box\"\n{{{MESH}}}")));
    let mesh = bake.mesh(&COUNTS, &[]);
    bake.surface("/World/Box", mesh, SurfaceOrigin::UsdPrim, 0, [0.0; 2]);
    bake.write();
    fs::copy(bake.output(), bake.folder.join("second.usda")).unwrap();
    let first = fs::read_to_string(bake.output()).unwrap().replace("@../room.usda@", "@./below.usda@");
    fs::rename(bake.input(), bake.folder.join("below.usda")).unwrap();
    fs::write(bake.input(), first).unwrap();
    bake.corners.surfaces[0].fill([Vec3::splat(9.0); 3]);
    let (stage, warnings) = bake.write();
    assert_eq!(warnings, [""; 0]);
    let colors: Vec<Vec3f> = get(&stage.prim("/World/Box").unwrap(), "primvars:displayColor").unwrap();
    assert_eq!(colors[0], Vec3f { x: 9.0, y: 9.0, z: 9.0 });
}

/// The folder of shared scenes, `None` where it is absent.
fn shared() -> Option<PathBuf> {
    let fallback = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    let folder = std::env::var_os("LUMEL_REFERENCE").map_or(fallback, PathBuf::from);
    if !folder.join("scenes").is_dir() {
        println!("skipped: {} is absent (set LUMEL_REFERENCE)", folder.display());
        return None;
    }
    Some(folder)
}

/// UVs that tell the face-varying corners of a mesh apart, v down.
fn uv_of_corner(corner: u32) -> Vec2 {
    Vec2::new((corner % 1021) as f32 / 1024.0, (corner / 1021 % 1021) as f32 / 1024.0)
}

/// Writes a layer for a scene as loaded, with made-up UVs, opens it, and compares each mesh that takes opinions of its own.
fn layer_over(input: &Path, folder: &Path, options: &LoadOptions) {
    // Many files of the collection are layers without geometry, or broken on purpose.
    let Ok(loaded) = load::load_with(input, options) else { return };
    let scene = &loaded.scene;
    let meshes = scene.meshes.iter().map(|m| MeshUvs {
        corners: m.origin.iter().map(|o| o.corners.map(uv_of_corner)).collect(),
        chart: vec![0; m.triangles.len()],
        chart_count: 1,
        authored: None,
    });
    let place = |i: usize| Placement { page: 0, scale: Vec2::splat(0.5), offset: Vec2::new(i as f32, 0.0) };
    let atlas = Atlas {
        pages: vec![[64, 64]],
        meshes: meshes.collect(),
        placements: (0..scene.surfaces.len()).map(place).collect(),
        density: 1.0,
        padding: 2,
        shown_pages: 1,
    };
    let color = |o: &TriangleOrigin| o.corners.map(|c| Vec3::splat((c % 7) as f32));
    let colors = scene.surfaces.iter().map(|s| scene.meshes[s.mesh].origin.iter().map(color).collect());
    let baked = Baked {
        scene,
        source: &loaded.source,
        atlas: &atlas,
        lightmap: None,
        quantity: Quantity::Outgoing,
        corners: Some(&CornerColors { surfaces: colors.collect() }),
        page_uris: &["lightmaps/scene_0.exr".to_string()],
        folder,
        lights: BakedLights::Mark,
    };
    fs::create_dir_all(folder.join("lightmaps")).unwrap();
    fs::write(folder.join("lightmaps/scene_0.exr"), "").unwrap();
    let output = folder.join("scene.lumel.usda");
    let start = std::time::Instant::now();
    let warnings = usd::write(&output, &baked).unwrap();
    let size = fs::metadata(&output).unwrap().len();
    println!(
        "{}: {} triangles, {} KB in {:.2?}",
        input.display(),
        scene.triangle_count(),
        size / 1024,
        start.elapsed()
    );
    for warning in warnings.iter() {
        println!("    {} x {} {:?}", warning.count, warning.message, warning.places);
    }

    let registry = openusd_schemas::schema_registry();
    let stage = Stage::builder().schema_registry(registry).open(output.to_str().unwrap()).unwrap();
    for (i, surface) in scene.surfaces.iter().enumerate() {
        let path = match &surface.origin {
            SurfaceOrigin::UsdPrim => surface.name.clone(),
            SurfaceOrigin::UsdInstance { root, prim } => format!("{root}/{prim}"),
            SurfaceOrigin::UsdPoint { prim, .. } => prim.clone(),
            _ => continue,
        };
        let prim = stage.prim(path.as_str()).unwrap();
        let name = token(&prim, "lumel:uvName").unwrap_or_else(|| panic!("{path}: no UVs"));
        let uvs = flat(&prim, &format!("primvars:{name}"));
        for corner in scene.meshes[surface.mesh].origin.iter().flat_map(|o| o.corners) {
            let uv = uv_of_corner(corner);
            assert_eq!(uvs[corner as usize], [uv.x, 1.0 - uv.y], "{path}");
        }
        if surface.origin == SurfaceOrigin::UsdPrim {
            assert_eq!(rectangle(&prim, "primvars:lumel:scaleOffset"), Some([0.5, 0.5, i as f32, 0.5]), "{path}");
        }
    }
}

#[test]
fn loaded_instances_take_a_layer() {
    for (name, usda) in [("chairs", chairs()), ("sets", sets()), ("trees", trees())] {
        let bake = Bake::new(&format!("loaded_{name}"), &usda);
        layer_over(&bake.input(), &bake.folder.join("room_baked"), &LoadOptions::default());
        let text = fs::read_to_string(bake.folder.join("room_baked/scene.lumel.usda")).unwrap();
        assert!(text.contains("primvars:lumel:scaleOffset:"), "{text}");
    }
}

#[test]
fn meshes_stand_in_for_shapes_and_refined_surfaces() {
    let usda = room(
        r#"def Sphere "Ball" { double radius = 2 color3f[] primvars:displayColor = [(1, 0, 0)] }
def Xform "Holder" (
    prepend variantSets = "form"
    variants = { string form = "none" }
)
{
    variantSet "form" = {
        "none" { }
        "cage" {
            def Mesh "Soft" {
                int[] faceVertexCounts = [4, 4]
                int[] faceVertexIndices = [0, 1, 2, 3, 1, 4, 5, 2]
                point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 1), (2, 1, 1)]
                float[] primvars:age = [1, 2] ( interpolation = "uniform" )
                def GeomSubset "second" {
                    uniform token elementType = "face"
                    uniform token familyName = "materialBind"
                    int[] indices = [1]
                }
            }
        }
    }
}"#,
    );
    let bake = Bake::new("stand_in", &usda);
    let variants = vec!["/World/Holder:form=cage".to_owned()];
    let options = LoadOptions { subdivide: 1, variants, ..LoadOptions::default() };
    let folder = bake.folder.join("room_baked");
    layer_over(&bake.input(), &folder, &options);
    let registry = openusd_schemas::schema_registry();
    let path = folder.join("scene.lumel.usda");
    let stage = Stage::builder().schema_registry(registry).open(path.to_str().unwrap()).unwrap();
    for (path, triangles) in [("/World/Ball", 2 * 48 * 23), ("/World/Holder/Soft", 16)] {
        let prim = stage.prim(path).unwrap();
        assert_eq!(prim.type_name().unwrap().unwrap().as_str(), "Mesh", "{path}");
        let counts: Vec<i32> = get(&prim, "faceVertexCounts").unwrap();
        assert_eq!(counts, vec![3; triangles], "{path}");
        let points: Vec<Vec3f> = get(&prim, "points").unwrap();
        let indices: Vec<i32> = get(&prim, "faceVertexIndices").unwrap();
        assert!(indices.iter().all(|&i| (i as usize) < points.len()));
    }
    let soft = stage.prim("/World/Holder/Soft").unwrap();
    assert!(get::<Vec<f32>>(&soft, "primvars:age").is_none(), "two values for sixteen faces");
    let second: Vec<i32> = get(&stage.prim("/World/Holder/Soft/second").unwrap(), "indices").unwrap();
    assert_eq!(second, (8..16).collect::<Vec<i32>>());
    let ball: Vec<Vec3f> = get(&stage.prim("/World/Ball").unwrap(), "primvars:displayColor").unwrap();
    assert_eq!(ball.len(), 1, "a colour that the look depends on stays");
}

#[test]
fn whole_scenes_take_a_layer() {
    let Some(shared) = shared() else { return };
    let mut files = Vec::new();
    find_stages(&shared.join("scenes"), &mut files);
    find_stages(&shared.join("reference"), &mut files);
    files.sort();
    assert!(!files.is_empty());
    for (i, file) in files.iter().enumerate() {
        let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join("write_usd_scenes").join(i.to_string());
        layer_over(file, &folder, &LoadOptions::default());
    }
}

/// Appends every USD file below `folder`.
fn find_stages(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            find_stages(&path, files);
        } else if path.extension().is_some_and(|e| ["usd", "usda", "usdc", "usdz"].map(Some).contains(&e.to_str())) {
            files.push(path);
        }
    }
}
