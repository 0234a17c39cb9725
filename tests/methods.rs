//! One scene by every method: the same picture, and the same bytes for any number of threads.

use std::path::Path;
use std::sync::Mutex;

use crate::common::{mean, options, read, run, write_scene};
use relievo::math::Vec3;
use relievo::render::camera;
use relievo::scene::{self, LoadOptions};
use relievo::trace::{Device, DeviceOptions};
use relievo::world::{BuildOptions, CacheSize, Method, World};

/// A house of quads and pentagons with a semi-sharp eave, displaced, twice; a ball of triangles by Loop's scheme,
/// displaced; a cube with creases by Chaikin's rule, which moves while the shutter is open; a die whose points move; a
/// NURBS sheet, trimmed to a disc and displaced.
/// Heights and colours are primvars of several kinds.
pub const SCENE: &str = r#"
def Camera "Camera" {
    float focalLength = 50
    float horizontalAperture = 24
    float verticalAperture = 24
    float2 clippingRange = (0.01, 1000)
    double shutter:open = 0
    double shutter:close = 1
    double3 xformOp:translate = (0, 0.4, 14)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def DomeLight "Sky" { float inputs:intensity = 0.5 }
def DistantLight "Sun" {
    float inputs:angle = 1
    float inputs:intensity = 2
    float3 xformOp:rotateXYZ = (-40, 30, 0)
    uniform token[] xformOpOrder = ["xformOp:rotateXYZ"]
}
def Material "Bumpy" {
    token outputs:surface.connect = </Bumpy/Surface.outputs:surface>
    token outputs:displacement.connect = </Bumpy/Surface.outputs:displacement>
    def Shader "Surface" {
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor.connect = </Bumpy/Tint.outputs:result>
        float inputs:displacement.connect = </Bumpy/Height.outputs:result>
        token outputs:displacement
        token outputs:surface
    }
    def Shader "Height" {
        uniform token info:id = "UsdPrimvarReader_float"
        string inputs:varname = "height"
        float inputs:fallback = 0.1
        float outputs:result
    }
    def Shader "Tint" {
        uniform token info:id = "UsdPrimvarReader_float3"
        string inputs:varname = "tint"
        float3 inputs:fallback = (0.8, 0.4, 0.3)
        float3 outputs:result
    }
}
class "Home" {
    def Mesh "House" (prepend apiSchemas = ["MaterialBindingAPI"]) {
        rel material:binding = </Bumpy>
        int[] faceVertexCounts = [4, 4, 4, 5, 5, 4, 4]
        int[] faceVertexIndices = [0, 3, 2, 1,  0, 1, 5, 4,  2, 3, 7, 6,  1, 2, 6, 9, 5,  3, 0, 4, 8, 7,  4, 5, 9, 8,  8, 9, 6, 7]
        point3f[] points = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1), (-1, 0, 2), (1, 0, 2)]
        int[] creaseIndices = [4, 5]
        int[] creaseLengths = [2]
        float[] creaseSharpnesses = [2.5]
        float[] primvars:height = [0, 0.2, 0.1, 0.3, 0, 0.1, 0.3, 0.1, 0.2, 0] (interpolation = "vertex")
        color3f[] primvars:tint = [(0.9, 0.2, 0.2), (0.2, 0.9, 0.2), (0.2, 0.2, 0.9), (0.9, 0.9, 0.2), (0.2, 0.9, 0.9), (0.9, 0.2, 0.9), (0.7, 0.7, 0.7)] (interpolation = "uniform")
    }
}
def "Left" (instanceable = true; references = </Home>) {
    float3 xformOp:rotateXYZ = (-90, 30, 0)
    double3 xformOp:translate = (-1.9, -1.9, 0)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
}
def "Right" (instanceable = true; references = </Home>) {
    float3 xformOp:rotateXYZ = (-60, -50, 20)
    double3 xformOp:translate = (1.9, -1.9, -1)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
}
def Mesh "Octahedron" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    rel material:binding = </Bumpy>
    uniform token subdivisionScheme = "loop"
    int[] faceVertexCounts = [3, 3, 3, 3, 3, 3, 3, 3]
    int[] faceVertexIndices = [0, 2, 4, 2, 1, 4, 1, 3, 4, 3, 0, 4, 2, 0, 5, 1, 2, 5, 3, 1, 5, 0, 3, 5]
    point3f[] points = [(1.4, 0, 0), (-1.4, 0, 0), (0, 1.4, 0), (0, -1.4, 0), (0, 0, 1.4), (0, 0, -1.4)]
    float[] primvars:height = [0.5] (interpolation = "constant")
    double3 xformOp:translate = (-2, 2.4, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Mesh "Chaikin" {
    int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
    int[] faceVertexIndices = [0, 3, 2, 1, 4, 5, 6, 7, 0, 1, 5, 4, 1, 2, 6, 5, 2, 3, 7, 6, 3, 0, 4, 7]
    point3f[] points = [(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)]
    int[] creaseIndices = [4, 5, 6, 7, 4]
    int[] creaseLengths = [5]
    float[] creaseSharpnesses = [1, 2, 3, 1.5]
    uniform token creaseMethod = "chaikin"
    color3f[] primvars:displayColor = [(0.4, 0.6, 0.8)]
    double3 xformOp:translate.timeSamples = { 0: (1.8, 2.2, 0), 1: (2.1, 2.6, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def NurbsPatch "Sheet" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    rel material:binding = </Bumpy>
    int uOrder = 3
    int vOrder = 2
    int uVertexCount = 3
    int vVertexCount = 2
    double[] uKnots = [0, 0, 0, 1, 1, 1]
    double[] vKnots = [0, 0, 1, 1]
    point3f[] points = [(-1.4, -1, 0), (0, -1, 1.5), (1.4, -1, 0), (-1.4, 1, 0), (0, 1, 1.5), (1.4, 1, 0)]
    double[] pointWeights = [1, 2, 1, 1, 2, 1]
    float[] primvars:height = [0, 0.3, 0, 0.2, 0, 0.2] (interpolation = "vertex")
    int[] trimCurve:counts = [1]
    int[] trimCurve:orders = [2]
    int[] trimCurve:vertexCounts = [5]
    double[] trimCurve:knots = [0, 0, 1, 2, 3, 4, 4]
    double2[] trimCurve:ranges = [(0, 4)]
    double3[] trimCurve:points = [(0.5, 0, 1), (1, 0.5, 1), (0.5, 1, 1), (0, 0.5, 1), (0.5, 0, 1)]
    double3 xformOp:translate = (0, -2.4, 2)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Mesh "Die" {
    int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
    int[] faceVertexIndices = [0, 3, 2, 1, 4, 5, 6, 7, 0, 1, 5, 4, 1, 2, 6, 5, 2, 3, 7, 6, 3, 0, 4, 7]
    point3f[] points.timeSamples = {
        0: [(-0.5, -0.5, -0.5), (0.5, -0.5, -0.5), (0.5, 0.5, -0.5), (-0.5, 0.5, -0.5), (-0.5, -0.5, 0.5), (0.5, -0.5, 0.5), (0.5, 0.5, 0.5), (-0.5, 0.5, 0.5)],
        1: [(-0.5, -0.5, -0.5), (0.5, -0.5, -0.5), (0.5, 0.5, -0.5), (-0.5, 0.5, -0.5), (0, -0.5, 0.5), (1, -0.5, 0.5), (1, 0.9, 0.5), (0, 0.9, 0.5)]
    }
    color3f[] primvars:displayColor = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (0, 1, 1), (1, 0, 1), (1, 1, 1), (0, 0, 0),
        (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (0, 1, 1), (1, 0, 1), (1, 1, 1), (0, 0, 0),
        (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (0, 1, 1), (1, 0, 1), (1, 1, 1), (0, 0, 0)] (interpolation = "faceVarying")
    double3 xformOp:translate = (0, 0.2, 1)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
"#;

fn picture(folder: &Path, scene: &Path, method: Method, threads: usize) -> Vec<Vec3> {
    let picture = folder.join(format!("{}-{threads}.exr", method.name()));
    let mut options = options(scene, &picture);
    options.resolution = Some([64, 64]);
    options.spp = 16;
    options.threads = threads;
    options.build.method = method.into();
    let stats = run(&options);
    assert_eq!(stats.non_finite_samples, 0, "{}", method.name());
    read(&picture).2
}

#[test]
fn every_method_shows_the_same_picture() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = write_scene(folder.path(), "scene.usda", SCENE);
    let reference = picture(folder.path(), &scene, Method::EmbreeTriangles, 2);
    let all = mean(&reference);
    assert!(all.min_element() > 0.05, "{all}");
    for method in Method::ALL {
        let one = picture(folder.path(), &scene, method, 1);
        let two = picture(folder.path(), &scene, method, 2);
        let bits = |p: &Vec3| p.to_array().map(f32::to_bits);
        let differing = one.iter().zip(&two).filter(|(a, b)| bits(a) != bits(b));
        assert_eq!(differing.count(), 0, "{}: by threads", method.name());
        let difference: Vec<Vec3> = (one.iter().zip(&reference))
            .map(|(a, b)| (*a - *b).abs())
            .collect();
        let (bias, difference) = (mean(&one) / all - Vec3::ONE, mean(&difference) / all);
        println!(
            "{}: mean off by {bias}, absolute difference {difference}",
            method.name()
        );
        assert!(
            bias.abs().max_element() < 0.01 && difference.max_element() < 0.03,
            "{}: {bias} {difference}",
            method.name()
        );
    }
}

/// Coarser micro-triangles for bounces change noise, not brightness, and nothing that the camera sees itself. Methods without
/// micro-triangles of the dicing show what they did.
#[test]
fn what_bounces_may_meet_coarser_micro_triangles() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = write_scene(folder.path(), "scene.usda", SCENE);
    for method in Method::ALL {
        let render = |bounce_dicing: Option<f32>, max_bounces: u32, threads: usize| {
            let picture = folder.path().join("bounces.exr");
            let mut options = options(&scene, &picture);
            options.resolution = Some([64, 64]);
            options.spp = 32;
            options.threads = threads;
            options.path.max_bounces = max_bounces;
            options.build.method = method.into();
            options.build.dicing.rate = 0.5;
            options.build.bounce_dicing = bounce_dicing;
            run(&options);
            read(&picture).2
        };
        let bits = |p: &Vec3| p.to_array().map(f32::to_bits);
        let differ = |a: &[Vec3], b: &[Vec3]| a.iter().zip(b).any(|(a, b)| bits(a) != bits(b));
        let (fine, coarse) = (render(None, 8, 2), render(Some(6.0), 8, 2));
        assert!(
            !differ(&coarse, &render(Some(6.0), 8, 1)),
            "{}: by threads",
            method.name()
        );
        // What Embree cannot subdivide is in its triangles.
        let is_diced = method.is_diced() || method == Method::EmbreeSubdivision;
        assert_eq!(differ(&fine, &coarse), is_diced, "{}", method.name());
        let bias = mean(&coarse) / mean(&fine) - Vec3::ONE;
        println!("{}: mean off by {bias}", method.name());
        assert!(bias.abs().max_element() < 3e-3, "{}: {bias}", method.name());
        // Without a bounce there is nothing to be met.
        let (fine, coarse) = (render(None, 0, 2), render(Some(6.0), 0, 2));
        assert!(!differ(&fine, &coarse), "{}: seen at once", method.name());
    }
}

/// Neither the size of the cache nor threads nor what is diced when make a difference of a bit.
#[test]
fn a_cache_of_any_size_shows_the_same_bytes() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = write_scene(folder.path(), "scene.usda", SCENE);
    let render = |size: usize, threads: usize| {
        let picture = folder.path().join(format!("{size}-{threads}.exr"));
        let mut options = options(&scene, &picture);
        options.resolution = Some([64, 64]);
        options.spp = 8;
        options.threads = threads;
        options.build.method = Method::Cache.into();
        options.build.cache_size = Some(CacheSize(size));
        options.build.dicing.rate = 0.5;
        let used = run(&options).cache.expect("it has a cache");
        println!("{size} bytes, {threads} threads: {used:?}");
        (std::fs::read(&picture).expect("a picture"), used)
    };
    let (reference, large) = render(64 << 20, 1);
    assert_eq!(large.diced, large.kept, "all of it fits");
    for (size, threads) in [
        (64 << 20, 3),
        (96 << 10, 1),
        (96 << 10, 2),
        (96 << 10, 16),
        (1, 2),
    ] {
        let (picture, used) = render(size, threads);
        // Threads may dice the same patch at once; what is given up is diced anew.
        let least = large.diced + u64::from(size < 64 << 20);
        assert!(used.diced >= least, "{size}: {used:?}");
        assert!(used.bytes <= size.max(1024));
        let (_, _, a) = read(&folder.path().join(format!("{}-1.exr", 64 << 20)));
        let (_, _, b) = read(&folder.path().join(format!("{size}-{threads}.exr")));
        let bits = |p: &Vec3| p.to_array().map(f32::to_bits);
        let differing = a.iter().zip(&b).filter(|(a, b)| bits(a) != bits(b)).count();
        assert_eq!(differing, 0, "{size} bytes, {threads} threads");
        assert_eq!(picture.len(), reference.len());
    }
}

/// Scales of the tortoise's shell, about as fine as pixels: whatever a method makes of them, it must not get in the way of
/// the light.
#[test]
fn deep_and_fine_detail_is_as_bright_by_every_method() {
    const SIZE: [u32; 2] = [240, 160];
    let folder = tempfile::tempdir().expect("a folder");
    let scene = Path::new("scenes/creature/creature.usda");
    let brightness = |method: Method| {
        let picture = folder.path().join(format!("{}.exr", method.name()));
        let mut options = options(scene, &picture);
        options.resolution = Some(SIZE);
        options.spp = 8;
        options.threads = 2;
        options.build.method = method.into();
        run(&options);
        let (width, _, pixels) = read(&picture);
        let middle = |i: usize| {
            let [x, y] = [i as u32 % width, i as u32 / width];
            (60..180).contains(&x) && (40..120).contains(&y)
        };
        let shell: Vec<Vec3> = (0..pixels.len())
            .filter(|&i| middle(i))
            .map(|i| pixels[i])
            .collect();
        mean(&shell)
    };
    let reference = brightness(Method::EmbreeTriangles);
    for method in [
        Method::EmbreeGrid,
        Method::Tessellated,
        Method::Compact,
        Method::Compressed,
        Method::Nonlinear,
        Method::Dbvh,
        Method::Cache,
    ] {
        let bias = brightness(method) / reference - Vec3::ONE;
        println!("{}: off by {bias}", method.name());
        // Slabs are as thick as detail is deep: how far a ray passes by them is a matter of choice.
        let most = match method {
            Method::Compressed => 0.05,
            _ => 0.01,
        };
        assert!(bias.abs().max_element() < most, "{}: {bias}", method.name());
    }
}

/// A trimmed square that glows, seen straight on: its disc, of which a corner beyond is lifted so that it is no even square.
/// `shell` is what else its prim says.
fn disc(schemas: &str, shell: &str) -> String {
    format!(
        r#"
def Camera "Camera" {{
    token projection = "orthographic"
    float horizontalAperture = 20
    float verticalAperture = 20
    float2 clippingRange = (0.01, 1000)
    double3 xformOp:translate = (0, 0, 5)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}}
def Material "Glow" {{
    token outputs:surface.connect = </Glow/Surface.outputs:surface>
    def Shader "Surface" {{
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor = (0, 0, 0)
        color3f inputs:emissiveColor = (1, 1, 1)
        float inputs:ior = 1
        token outputs:surface
    }}
}}
def DomeLight "Night" {{ float inputs:intensity = 0 }}
class "Tiles" {{
    def Mesh "Plate" {{
        uniform token subdivisionScheme = "none"
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(0, 0, 0.5), (1, 0, 0.5), (1, 1, 0.5), (0, 1, 0.5)]
    }}
}}
def NurbsPatch "Disc" (prepend apiSchemas = ["MaterialBindingAPI"{schemas}]) {{
    {shell}
    rel material:binding = </Glow>
    int uOrder = 2
    int vOrder = 2
    int uVertexCount = 2
    int vVertexCount = 2
    double[] uKnots = [-1, -1, 1, 1]
    double[] vKnots = [-1, -1, 1, 1]
    point3f[] points = [(-1, -1, 0), (1, -1, 0), (-1, 1, 0), (1, 1, 0.001)]
    int[] trimCurve:counts = [1]
    int[] trimCurve:orders = [3]
    int[] trimCurve:vertexCounts = [9]
    double[] trimCurve:knots = [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4]
    double2[] trimCurve:ranges = [(0, 4)]
    double3[] trimCurve:points = [(0.8, 0, 1), (0.5656854, 0.5656854, 0.7071068), (0, 0.8, 1), (-0.5656854, 0.5656854, 0.7071068), (-0.8, 0, 1), (-0.5656854, -0.5656854, 0.7071068), (0, -0.8, 1), (0.5656854, -0.5656854, 0.7071068), (0.8, 0, 1)]
}}
"#
    )
}

/// That every method covers the disc.
fn covers_its_disc(body: &str) {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = write_scene(folder.path(), "disc.usda", body);
    for method in Method::ALL {
        let covered = mean(&picture(folder.path(), &scene, method, 0)).x;
        let exact = 0.25 * std::f32::consts::PI * 0.64;
        assert!(
            (covered - exact).abs() < 2e-3,
            "{}: {covered} for {exact}",
            method.name()
        );
    }
}

#[test]
fn a_trimmed_square_covers_its_disc() {
    covers_its_disc(&disc("", ""));
    let even = disc("", "").replace("0.001", "0");
    covers_its_disc(&even);
}

#[test]
fn tiles_end_where_the_patch_below_is_trimmed() {
    let shell = "rel relievo:shell:tile = </Tiles/Plate>
    float2 relievo:shell:repeats = (7, 5)
    float relievo:shell:height = 0.1";
    covers_its_disc(&disc(", \"RelievoShellAPI\"", shell));
}

/// A single surface that takes its time tells how far it is, and can be ended, by every method of ours.
#[test]
fn a_build_tells_how_far_it_is_and_can_be_ended() {
    let folder = tempfile::tempdir().expect("a folder");
    let cells = 40;
    let points: Vec<_> = (0..=cells)
        .flat_map(|j| (0..=cells).map(move |i| (i, j, (i * j) % 3)))
        .collect();
    let corner = |i: i32, j: i32| j * (cells + 1) + i;
    let indices: Vec<i32> = (0..cells)
        .flat_map(|j| (0..cells).map(move |i| (i, j)))
        .flat_map(|(i, j)| {
            let (near, far) = ([i, i + 1], [j, j + 1]);
            [
                (near[0], far[0]),
                (near[1], far[0]),
                (near[1], far[1]),
                (near[0], far[1]),
            ]
        })
        .map(|(i, j)| corner(i, j))
        .collect();
    let counts = vec![4; (cells * cells) as usize];
    let body = format!(
        "def Mesh \"Field\" {{\nint[] faceVertexCounts = {counts:?}\nint[] faceVertexIndices = {indices:?}\n\
         point3f[] points = {points:?}\n}}\n"
    );
    let path = write_scene(folder.path(), "field.usda", &body);
    let scene = scene::load(&path, &LoadOptions::default()).expect("a scene");
    let view = camera(&scene, [1000, 1000]).expect("a camera");
    for method in Method::ALL {
        if method == Method::EmbreeSubdivision {
            continue;
        }
        let options = BuildOptions {
            method: method.into(),
            default_dome: 1.0,
            ..BuildOptions::default()
        };
        let device = Device::new(&DeviceOptions::default()).expect("a device");
        // What is told beyond the first half is Embree's.
        let told = Mutex::new(Vec::new());
        let build = |last: f64| {
            World::build(&scene, &view, &device, &options, &|done| {
                told.lock().expect("no panic").push(done);
                done < last
            })
        };
        build(2.0).expect("nobody ends it");
        let halfway = std::mem::take(&mut *told.lock().expect("no panic"));
        let between = halfway.iter().filter(|done| (0.01..0.49).contains(*done));
        assert!(between.count() >= 2, "{}: {halfway:?}", method.name());
        let ended = build(0.2).map(|_| ()).expect_err("it is ended");
        assert_eq!(ended.exit_code(), 130, "{}: {ended}", method.name());
        let told = told.lock().expect("no panic");
        assert!(told.len() < halfway.len(), "{}: {told:?}", method.name());
    }
}
