//! Small files of our own.

use std::path::PathBuf;

use tempfile::TempDir;

use super::load;
use crate::error::{Error, Fault};
use crate::image::{ColorSpace, ImageSource, Wrap};
use crate::math::{DVec3, Vec3, Vec4};
use crate::mesh::{BoundaryInterpolation, Interpolation, Scheme, TriangleRule};
use crate::scene::{
    Channels, Description, Input, LightKind, LoadOptions, MissingLayers, Projection,
};

const QUAD: &str = "int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]";

fn write(body: &str) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("scene.usda");
    std::fs::write(&file, format!("#usda 1.0\n{body}")).expect("a file");
    (folder, file)
}

pub(super) fn read(body: &str) -> Description {
    let (_folder, file) = write(body);
    load(&file, &LoadOptions::default()).expect("a scene")
}

pub(super) fn refused(body: &str) -> Fault {
    let (_folder, file) = write(body);
    match load(&file, &LoadOptions::default()) {
        Err(Error::Input(fault)) => *fault,
        other => panic!("not refused: {other:?}"),
    }
}

pub(super) fn kinds(scene: &Description) -> Vec<String> {
    scene.warnings.iter().map(|w| w.kind.clone()).collect()
}

#[test]
fn every_attribute_of_a_mesh() {
    let scene = read(
        r#"(
    metersPerUnit = 0.1
    upAxis = "Z"
)
def Mesh "M" {
    int[] faceVertexCounts = [4, 4]
    int[] faceVertexIndices = [0, 1, 2, 3, 3, 2, 4, 5]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (1, 2, 0), (0, 2, 0)]
    int[] holeIndices = [1]
    int[] cornerIndices = [0]
    float[] cornerSharpnesses = [3]
    int[] creaseIndices = [0, 1, 2, 4, 5]
    int[] creaseLengths = [3, 2]
    float[] creaseSharpnesses = [1, 2, 10]
    uniform token orientation = "leftHanded"
    token interpolateBoundary = "none"
    token triangleSubdivisionRule = "smooth"
    uniform bool doubleSided = 1
    texCoord2h[] primvars:st = [(0, 0), (1, 0)] ( interpolation = "faceVarying" )
    int[] primvars:st:indices = [0, 1, 1, 0, 0, 1, 1, 0]
    double[] primvars:two = [1, 2, 3, 4] ( interpolation = "uniform"
        elementSize = 2 )
    int[] primvars:ids = [1, 2] ( interpolation = "uniform" )
    color3f[] primvars:displayColor = [(1, 0, 0)]
}"#,
    );
    assert_eq!((scene.up, scene.meters_per_unit), (Vec3::Z, 0.1));
    let shape = &scene.shapes[0];
    let mesh = shape.geometry.mesh().expect("a mesh");
    assert!(shape.double_sided && mesh.left_handed);
    assert_eq!(mesh.scheme, Scheme::CatmullClark);
    assert_eq!(mesh.boundary, BoundaryInterpolation::None);
    assert_eq!(mesh.triangle_rule, TriangleRule::Smooth);
    assert_eq!(
        (mesh.holes.as_slice(), mesh.corners[0].sharpness),
        (&[1][..], 3.0)
    );
    let creases: Vec<_> = mesh
        .creases
        .iter()
        .map(|c| (c.vertices, c.sharpness))
        .collect();
    assert_eq!(creases, [([0, 1], 1.0), ([1, 2], 2.0), ([4, 5], 10.0)]);
    let st = mesh.primvar("st").expect("st");
    assert_eq!(
        (st.width, st.interpolation),
        (2, Interpolation::FaceVarying)
    );
    assert_eq!(st.get(1), [1.0, 0.0]);
    assert_eq!(mesh.primvar("two").expect("two").width, 2);
    assert!(mesh.primvar("ids").is_none());
    assert_eq!(
        mesh.primvar("displayColor").expect("colour").get(0),
        [1.0, 0.0, 0.0]
    );
    assert_eq!(scene.placements[0].display_color, None);
}

#[test]
fn wrong_counts_name_the_prim() {
    for (extra, message) in [
        ("int[] creaseIndices = [0, 1]", "creaseLengths add up to 0"),
        (
            "int[] creaseIndices = [0, 1, 2]
            int[] creaseLengths = [3]
            float[] creaseSharpnesses = [1, 2, 3]",
            "3 creaseSharpnesses for 1 creases of 2 edges",
        ),
        (
            "int[] cornerIndices = [0]",
            "0 cornerSharpnesses for 1 cornerIndices",
        ),
        (
            "int[] cornerIndices = [0]
            float[] cornerSharpnesses = [-1]",
            "sharpness -1",
        ),
        ("int[] holeIndices = [-1]", "holeIndices hold -1"),
    ] {
        let fault = refused(&format!("def Mesh \"Bad\" {{ {QUAD}\n{extra}\n}}"));
        assert!(fault.message.contains(message), "{fault}");
        assert_eq!(fault.prim.as_deref(), Some("/Bad"));
        assert!(fault.file.is_some());
    }
}

#[test]
fn a_primvar_that_does_not_fit_is_left_out() {
    let scene = read(&format!(
        "def Mesh \"Bad\" {{ {QUAD}
        float[] primvars:a = [1, 2] (interpolation = \"vertex\")
        float[] primvars:b = [1, 2] (interpolation = \"uniform\")
        float[] primvars:c = [1, 2, 3, 4] (interpolation = \"vertex\") }}"
    ));
    let shape = &scene.shapes[0];
    let kept: Vec<&str> = shape
        .geometry
        .primvars()
        .iter()
        .map(|p| p.name.as_str())
        .collect();
    assert_eq!(kept, ["c"]);
    let left_out: Vec<&str> = shape
        .unusable_primvars
        .iter()
        .map(|p| p.name.as_str())
        .collect();
    assert_eq!(left_out, ["a", "b"]);
    assert_eq!(kinds(&scene), ["unusable primvar"]);
    let fault = &shape.unusable_primvars[0].fault;
    assert!(
        fault
            .message
            .contains("primvar a has 2 elements for 4 points"),
        "{fault}"
    );
}

#[test]
fn damaged_files_are_refused() {
    let deep = "def \"A\" {".repeat(2000);
    assert!(refused(&deep).message.contains("nest"));
    refused("def Mesh \"A\" { int[] x = [1, ");
    let missing = load(&PathBuf::from("no-such-file.usda"), &LoadOptions::default());
    assert!(matches!(missing, Err(Error::Input(f)) if f.file.is_some()));
}

#[test]
fn a_missing_reference_and_a_bad_instancer_are_faults() {
    let body = format!(
        "def Xform \"A\" ( references = @./gone.usda@ ) {{ }}\ndef Mesh \"M\" {{ {QUAD} }}"
    );
    let fault = refused(&body);
    assert!(
        fault.message.contains("gone.usda") && fault.message.contains("/A"),
        "{fault}"
    );
    let (_folder, file) = write(&body);
    let options = LoadOptions {
        missing_layers: MissingLayers::Skip,
        ..LoadOptions::default()
    };
    let scene = load(&file, &options).expect("a scene");
    assert_eq!(scene.placements.len(), 1);
    assert!(kinds(&scene).iter().any(|k| k.starts_with("composition: ")));
    let fault = refused(
        "def PointInstancer \"P\" { int[] protoIndices = [0]
        rel prototypes = </P/Q>
        def Xform \"Q\" { } }",
    );
    assert!(
        fault.message.contains("0 positions for 1 protoIndices"),
        "{fault}"
    );
}

#[test]
fn transforms_purpose_and_visibility_are_inherited() {
    let scene = read(&format!(
        r#"def Xform "W" {{
    double3 xformOp:translate = (1, 2, 3)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    color3f[] primvars:displayColor = [(0, 1, 0)]
    float primvars:k = 7
    def Mesh "A" {{ {QUAD}
        float3 xformOp:scale = (2, 2, 2)
        uniform token[] xformOpOrder = ["xformOp:scale"] }}
    def Mesh "Reset" {{ {QUAD}
        uniform token[] xformOpOrder = ["!resetXformStack!"] }}
    def Mesh "Flat" {{ {QUAD}
        float3 xformOp:scale = (1, 0, 1)
        uniform token[] xformOpOrder = ["xformOp:scale"] }}
    def Xform "Hidden" {{ token visibility = "invisible"
        def Mesh "H" {{ {QUAD} }} }}
    def Xform "Guide" {{ uniform token purpose = "guide"
        def Mesh "G" {{ {QUAD} }} }}
    def Mesh "Empty" {{ }}
    def NurbsPatch "N" {{ }}
    def Points "Points" {{ }}
    over "O" {{ }}
    class Mesh "C" {{ {QUAD} }}
}}"#
    ));
    let paths: Vec<_> = scene.placements.iter().map(|p| p.path.as_str()).collect();
    assert_eq!(paths, ["/W/A", "/W/Reset"]);
    let at = |i: usize| scene.placements[i].world_from_object[0];
    assert_eq!(
        at(0).transform_point3(DVec3::ONE),
        DVec3::new(3.0, 4.0, 5.0)
    );
    assert_eq!(at(1).translation, DVec3::ZERO);
    assert_eq!(scene.placements[0].display_color, Some(Vec3::Y));
    assert_eq!(
        scene.shapes[0].geometry.primvar("k").expect("k").values,
        [7.0]
    );
    let kinds = kinds(&scene);
    for kind in [
        "unusable transform",
        "empty mesh",
        "empty patch",
        "unsupported prim type Points",
    ] {
        assert!(kinds.iter().any(|k| k == kind), "{kinds:?}");
    }
}

#[test]
fn instances_share_their_shapes() {
    let scene = read(&format!(
        r#"class "Proto" {{ def Mesh "M" {{ {QUAD} }}
    def Xform "Inner" ( instanceable = true
        inherits = </Leaf> ) {{ }} }}
class "Leaf" {{ def Mesh "L" {{ {QUAD} }} }}
def Xform "A" ( instanceable = true
    inherits = </Proto> ) {{
    double3 xformOp:translate = (5, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"] }}
def Xform "B" ( instanceable = true
    inherits = </Proto> ) {{ color3f[] primvars:displayColor = [(0, 0, 1)] }}"#
    ));
    let of = |path: &str| {
        scene
            .placements
            .iter()
            .find(|p| p.path == path)
            .expect("a placement")
    };
    let (a, b) = (of("/A/M"), of("/B/M"));
    assert_eq!(a.shape, b.shape);
    assert_eq!(a.world_from_object[0].translation.x, 5.0);
    assert_eq!(b.display_color, Some(Vec3::Z));
}

#[test]
fn point_instancers_place_their_prototypes() {
    let scene = read(&format!(
        r#"def PointInstancer "P" {{
    double3 xformOp:translate = (0, 0, 10)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    rel prototypes = [</P/Q>, </P/R>]
    int[] protoIndices = [0, 1, 0, 0]
    int64[] ids = [10, 20, 30, 40]
    int64[] invisibleIds = [30]
    point3f[] positions = [(1, 0, 0), (2, 0, 0), (3, 0, 0), (4, 0, 0)]
    quath[] orientations = [(1, 0, 0, 0), (1, 0, 0, 0), (1, 0, 0, 0), (0, 0, 0, 1)]
    float3[] scales = [(2, 2, 2), (1, 1, 1), (1, 1, 1), (1, 1, 1)]
    def Mesh "Q" {{ {QUAD}
        double3 xformOp:translate = (0, 1, 0)
        uniform token[] xformOpOrder = ["xformOp:translate"] }}
    def Xform "R" {{ def Mesh "M" {{ {QUAD} }} }}
}}"#
    ));
    let found: Vec<_> = scene
        .placements
        .iter()
        .map(|p| (p.path.as_str(), p.world_from_object[0].translation))
        .collect();
    assert_eq!(found.len(), 3);
    assert_eq!(found[0], ("/P/instance_0", DVec3::new(1.0, 2.0, 10.0)));
    assert_eq!(found[1], ("/P/instance_1/M", DVec3::new(2.0, 0.0, 10.0)));
    assert!((found[2].1 - DVec3::new(4.0, -1.0, 10.0)).length() < 1e-6);
    assert_eq!(scene.placements[0].shape, scene.placements[2].shape);
    let fault = refused("def PointInstancer \"P\" { int[] protoIndices = [0] }");
    assert_eq!(fault.prim.as_deref(), Some("/P"));
}

#[test]
fn the_shutter_makes_motion_keys() {
    let body = format!(
        r#"( startTimeCode = 1
)
def Camera "C" {{ double shutter:open = -0.25
    double shutter:close = 0.25 }}
def Mesh "T" {{ {QUAD}
    double3 xformOp:translate.timeSamples = {{ 0: (0, 0, 0), 2: (2, 0, 0) }}
    uniform token[] xformOpOrder = ["xformOp:translate"] }}
def Mesh "R" {{ {QUAD}
    float xformOp:rotateZ.timeSamples = {{ 0: 0, 2: 360 }}
    uniform token[] xformOpOrder = ["xformOp:rotateZ"] }}
def Mesh "V" {{ {QUAD}
    vector3f[] velocities = [(24, 0, 0), (24, 0, 0), (24, 0, 0), (24, 0, 0)] }}
def Mesh "P" {{
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points.timeSamples = {{ 0: [(0, 0, 0), (1, 0, 0), (0, 1, 0)], 2: [(2, 0, 0), (3, 0, 0), (2, 1, 0)] }} }}"#
    );
    let scene = read(&body);
    assert_eq!(scene.frame, Some(1.0));
    let keys = &scene.placements[0].world_from_object;
    assert_eq!(
        (keys.len(), keys[0].translation.x, keys[1].translation.x),
        (2, 0.75, 1.25)
    );
    assert!(scene.placements[1].world_from_object.len() > 2);
    let points = |i: usize| &scene.shapes[i].geometry.mesh().expect("a mesh").points;
    assert_eq!(
        (points(0).len(), points(2).len(), points(3).len()),
        (1, 2, 2)
    );
    assert_eq!((points(2)[0][0].x, points(2)[1][0].x), (-0.25, 0.25));
    assert_eq!((points(3)[0][0].x, points(3)[1][0].x), (0.75, 1.25));
    let (_folder, file) = write(&body);
    let still = LoadOptions {
        motion_blur: false,
        ..LoadOptions::default()
    };
    let scene = load(&file, &still).expect("a scene");
    assert!(
        scene
            .placements
            .iter()
            .all(|p| p.world_from_object.len() == 1)
    );
}

#[test]
fn cameras_lights_and_settings() {
    let scene = read(
        r#"( renderSettingsPrimPath = "/S" )
def Camera "C" { token projection = "orthographic"
    float focalLength = 35
    float fStop = 4 }
def RectLight "R" ( prepend apiSchemas = ["ShapingAPI"] ) { float inputs:width = 3
    float inputs:intensity = 2
    float inputs:exposure = 1
    float inputs:shaping:cone:angle = 30 }
def DistantLight "D" { }
def DomeLight_1 "Z" { uniform token poleAxis = "Z" }
def SphereLight "T" { bool inputs:enableColorTemperature = 1
    float inputs:colorTemperature = 3000
    float inputs:radius = 0 }
def CylinderLight "Y" { bool inputs:enableColorTemperature = 1
    float inputs:colorTemperature = 3000 }
def RenderSettings "S" { rel camera = </C>
    int2 resolution = (64, 32)
    rel products = </S/P>
    def RenderProduct "P" { token productName = "a.exr"
        rel orderedVars = </S/P/V>
        def RenderVar "V" { string sourceName = "Ci" } } }"#,
    );
    let camera = &scene.cameras[0];
    assert_eq!(camera.projection, Projection::Orthographic);
    assert_eq!(
        (camera.focal_length, camera.f_stop, camera.exposure),
        (35.0, 4.0, 0.0)
    );
    let light = |path: &str| scene.lights.iter().find(|l| l.path == path);
    let rect = light("/R").expect("rect");
    assert_eq!(
        (rect.color, rect.shaping.map(|s| s.cone_angle)),
        (Vec3::splat(4.0), Some(30.0))
    );
    assert!(matches!(rect.kind, LightKind::Rect { width: 3.0, .. }));
    assert_eq!(light("/D").expect("sun").color.x, 50000.0);
    let pole = light("/Z")
        .expect("dome")
        .world_from_light
        .transform_vector3(DVec3::Y);
    assert!((pole - DVec3::Z).length() < 1e-12);
    assert!(light("/T").is_none());
    let warm = light("/Y").expect("warm").color;
    assert!(warm.x > warm.y && warm.y > warm.z);
    assert_eq!(scene.settings.resolution, Some([64, 32]));
    assert_eq!(scene.settings.camera.as_deref(), Some("/C"));
    assert_eq!(scene.settings.product_name.as_deref(), Some("a.exr"));
    assert_eq!(scene.settings.aovs, ["Ci"]);
    let neutral = super::light::blackbody(6500.0);
    assert!(
        (neutral - Vec3::ONE).abs().max_element() < 0.06,
        "{neutral}"
    );
}

#[test]
fn materials_are_followed_through_their_network() {
    let scene = read(&format!(
        r#"def Mesh "M" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {{
    int[] faceVertexCounts = [3, 3]
    int[] faceVertexIndices = [0, 1, 2, 0, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    rel material:binding = </X>
    def GeomSubset "S" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {{
        uniform token familyName = "materialBind"
        int[] indices = [1]
        rel material:binding = </Y> }}
}}
def Mesh "Gone" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {{ {QUAD}
    rel material:binding = </NoSuch> }}
def Material "X" {{
    float inputs:rough = 0.25
    token outputs:surface.connect = </X/P.outputs:surface>
    token outputs:displacement.connect = </X/P.outputs:displacement>
    def Shader "P" {{ uniform token info:id = "UsdPreviewSurface"
        float inputs:roughness.connect = </X.inputs:rough>
        color3f inputs:diffuseColor.connect = </X/T.outputs:rgb>
        float inputs:displacement.connect = </X/T.outputs:g>
        float inputs:metallic.connect = </X/R.outputs:result>
        token outputs:surface
        token outputs:displacement }}
    def Shader "R" {{ uniform token info:id = "UsdPrimvarReader_float"
        string inputs:varname = "metal"
        float inputs:fallback = 0.5
        float outputs:result }}
    def Shader "T" {{ uniform token info:id = "UsdUVTexture"
        asset inputs:file = @tex/a.<UDIM>.exr@
        token inputs:wrapS = "repeat"
        token inputs:sourceColorSpace = "raw"
        float4 inputs:scale = (2, 2, 2, 1)
        float2 inputs:st.connect = </X/F.outputs:result>
        float3 outputs:rgb
        float outputs:g }}
    def Shader "F" {{ uniform token info:id = "UsdTransform2d"
        float2 inputs:scale = (3, 4)
        float inputs:rotation = 90
        float2 inputs:in.connect = </X/U.outputs:result>
        float2 outputs:result }}
    def Shader "U" {{ uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "map1"
        float2 outputs:result }}
}}
def Material "Y" {{ token outputs:surface.connect = </Y/G.outputs:out>
    def NodeGraph "G" {{ token outputs:out.connect = </Y/G/P.outputs:surface>
        def Shader "P" {{ uniform token info:id = "UsdPreviewSurface"
            token outputs:surface }} }} }}"#
    ));
    let shape = &scene.shapes[0];
    assert_eq!(shape.materials.subsets[0].faces, [1]);
    assert!(shape.materials.subsets[0].material.is_some());
    let surface = &scene.materials[shape.materials.whole.expect("X")].surface;
    assert_eq!(surface.roughness, Input::Value(0.25));
    let Input::Texture(map) = &surface.diffuse_color else {
        panic!("no texture");
    };
    assert_eq!(
        (map.primvar.as_str(), map.channels),
        ("map1", Channels::Rgb)
    );
    assert_eq!(
        (map.scale, map.transform.rotation),
        (Vec4::new(2.0, 2.0, 2.0, 1.0), 90.0)
    );
    let texture = &scene.textures[map.texture];
    assert_eq!(
        (texture.wrap_s, texture.wrap_t),
        (Wrap::Repeat, Wrap::Black)
    );
    assert_eq!(texture.color_space, ColorSpace::Raw);
    let ImageSource::File(file) = &texture.image else {
        panic!("not a file");
    };
    assert!(
        file.is_absolute() && file.ends_with("tex/a.<UDIM>.exr"),
        "{file:?}"
    );
    assert!(matches!(&surface.displacement, Input::Texture(m) if m.channels == Channels::G));
    assert!(
        matches!(&surface.metallic, Input::Primvar { name, fallback } if name == "metal" && *fallback == 0.5)
    );
    assert_eq!(scene.textures.len(), 1);
    assert_eq!(scene.shapes[1].materials.whole, None);
    assert!(kinds(&scene).iter().any(|k| k == "missing material"));
}
