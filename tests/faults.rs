//! What ends a render early ends it cleanly: memory that is refused, interrupts, closures that fail. Nothing is left
//! behind, and the next render in the same process is as good as any.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use crate::common::{options, read, write_scene};
use crate::methods::SCENE;
use relievo::Error;
use relievo::math::{Ray, Vec3};
use relievo::memory::Budget;
use relievo::render::{Progress, ProgressStyle, RenderOptions, camera, render};
use relievo::scene::{self, LoadOptions};
use relievo::surface::{Amount, Displacement, Function, Rates, Subdivision, Surface};
use relievo::trace::{Device, DeviceOptions, SceneBuilder};
use relievo::world::{BuildOptions, CacheSize, Choice, How, MaxError, Method, World};

/// A few small shapes, one of them in two places, one displaced.
const SMALL: &str = r#"
def Camera "Camera" {
    double3 xformOp:translate = (0, 0, 12)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def RectLight "Lamp" { float inputs:intensity = 5 }
def SphereLight "Bulb" { float inputs:radius = 0.1 }
def Material "Bumpy" {
    token outputs:surface.connect = </Bumpy/Surface.outputs:surface>
    token outputs:displacement.connect = </Bumpy/Surface.outputs:displacement>
    def Shader "Surface" {
        uniform token info:id = "UsdPreviewSurface"
        float inputs:displacement = 0.1
        token outputs:displacement
        token outputs:surface
    }
}
class "Block" {
    def Mesh "Cube" (prepend apiSchemas = ["MaterialBindingAPI"]) {
        rel material:binding = </Bumpy>
        int[] faceVertexCounts = [4, 4, 4, 4, 4, 4]
        int[] faceVertexIndices = [0, 3, 2, 1, 4, 5, 6, 7, 0, 1, 5, 4, 1, 2, 6, 5, 2, 3, 7, 6, 3, 0, 4, 7]
        point3f[] points = [(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)]
    }
}
def "Left" (instanceable = true; references = </Block>) {
    double3 xformOp:translate = (-2, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def "Right" (instanceable = true; references = </Block>) {
    double3 xformOp:translate = (2, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Mesh "Floor" {
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    point3f[] points = [(-4, -2, -4), (4, -2, -4), (4, -2, 4), (-4, -2, 4)]
}
def Sphere "Ball" { double radius = 0.7 }
"#;

fn small(scene: &Path, picture: &Path, method: Choice) -> RenderOptions {
    let mut options = options(scene, picture);
    options.resolution = Some([24, 16]);
    options.spp = 1;
    options.threads = 1;
    options.build.method = method;
    options.build.cache_size = Some(CacheSize(1 << 20));
    options.build.bounce_dicing = Some(2.0);
    options
}

fn quietly(options: &RenderOptions, interrupt: &AtomicBool) -> Result<(), Error> {
    render(options, &Progress::new(ProgressStyle::Quiet), interrupt).map(|_| ())
}

fn all() -> impl Iterator<Item = Choice> {
    Method::ALL
        .into_iter()
        .map(Choice::One)
        .chain([Choice::Auto])
}

/// Whichever question for memory is answered by no, ours or Embree's.
#[test]
fn wherever_memory_is_refused_it_ends_with_exit_code_4() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = write_scene(folder.path(), "scene.usda", SMALL);
    let picture = folder.path().join("out.exr");
    for method in all() {
        let mut options = small(&scene, &picture, method);
        quietly(&options, &AtomicBool::new(false)).expect("nothing is refused");
        let whole = read(&picture);
        let (mut refusals, mut time) = (0, 0);
        loop {
            std::fs::remove_file(&picture).expect("a picture");
            options.memory_budget = Budget::refusing_once(1 << 40, time);
            match quietly(&options, &AtomicBool::new(false)) {
                Ok(()) => {
                    assert!(
                        options.memory_budget.asked() <= time,
                        "{}, {time}",
                        method.name()
                    );
                    break;
                }
                Err(error) => {
                    assert_eq!(error.exit_code(), 4, "{}, {time}: {error}", method.name());
                    assert!(error.help().is_some(), "{error}");
                    refusals += 1;
                }
            }
            let left = std::fs::read_dir(folder.path()).expect("a folder").count();
            assert_eq!(
                left,
                1,
                "{}, {time}: only the scene is there",
                method.name()
            );
            // For the removal above.
            std::fs::write(&picture, "").expect("the folder takes files");
            time += 1;
        }
        println!("{}: {refusals} refusals", method.name());
        assert!(refusals >= 10, "{}: {refusals}", method.name());
        assert_eq!(read(&picture), whole, "{}: the next picture", method.name());
    }
}

/// Ended at any time at which it tells how far it is, and built again.
#[test]
fn a_build_can_be_ended_at_any_time() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = write_scene(folder.path(), "scene.usda", SMALL);
    let scene = scene::load(&path, &LoadOptions::default()).expect("a scene");
    let view = camera(&scene, [60, 40]).expect("a camera");
    for method in all() {
        let options = BuildOptions {
            method,
            cache_size: Some(CacheSize(1 << 20)),
            bounce_dicing: Some(2.0),
            ..BuildOptions::default()
        };
        let device = Device::new(&DeviceOptions::default()).expect("a device");
        let before = device.memory();
        let mut ended = 0;
        for last in 0.. {
            let told = AtomicUsize::new(0);
            let built = World::build(&scene, &view, &device, &options, &|_| {
                told.fetch_add(1, Ordering::Relaxed) != last
            });
            match built {
                Ok(built) => {
                    drop(built);
                    assert_eq!(device.memory(), before, "{}", method.name());
                    break;
                }
                Err(error) => {
                    assert_eq!(error.exit_code(), 130, "{}, {last}: {error}", method.name());
                    assert_eq!(device.memory(), before, "{}, {last}", method.name());
                    ended += 1;
                }
            }
        }
        assert!(ended > 5, "{}: {ended}", method.name());
    }
}

/// What was rendered until then is a picture.
#[test]
fn a_render_that_is_interrupted_writes_its_picture() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = write_scene(folder.path(), "scene.usda", SCENE);
    let picture = folder.path().join("out.exr");
    for method in [Method::EmbreeGrid, Method::Cache] {
        let mut options = small(&scene, &picture, method.into());
        options.spp = 65_536;
        options.threads = 2;
        let interrupt = Arc::new(AtomicBool::new(false));
        let ended = std::thread::scope(|scope| {
            let flag = interrupt.clone();
            let rendering = scope.spawn(|| quietly(&options, &interrupt));
            std::thread::sleep(Duration::from_millis(1500));
            flag.store(true, Ordering::Relaxed);
            rendering.join().expect("no panic")
        });
        assert!(matches!(ended, Err(Error::Interrupted)), "{ended:?}");
        let (width, height, pixels) = read(&picture);
        assert_eq!((width, height), (24, 16));
        assert!(pixels.iter().all(|p| p.is_finite()));
        std::fs::remove_file(&picture).expect("a picture");
    }
}

/// Two renders at once in one process do not see each other.
#[test]
fn two_renders_at_once_are_two_renders() {
    let folder = tempfile::tempdir().expect("a folder");
    let scene = write_scene(folder.path(), "scene.usda", SMALL);
    let run = |name: &str, method: Choice, seed: u32| {
        let picture = folder.path().join(name);
        let mut options = small(&scene, &picture, method);
        options.spp = 8;
        options.threads = 2;
        options.seed = seed;
        quietly(&options, &AtomicBool::new(false)).expect("a picture");
        read(&picture)
    };
    let methods = [
        Choice::One(Method::Cache),
        Choice::One(Method::EmbreeGrid),
        Choice::Auto,
    ];
    let alone: Vec<_> = (0..)
        .zip(methods)
        .map(|(seed, method)| run(&format!("alone{seed}.exr"), method, seed))
        .collect();
    let run = &run;
    let together: Vec<_> = std::thread::scope(|scope| {
        let running: Vec<_> = (0..)
            .zip(methods)
            .map(|(seed, method)| {
                scope.spawn(move || run(&format!("together{seed}.exr"), method, seed))
            })
            .collect();
        running
            .into_iter()
            .map(|r| r.join().expect("no panic"))
            .collect()
    });
    assert!(alone == together);
}

/// A displacement that panics while it is diced, or while rays are traced, is an error; one that gives no numbers is none.
#[test]
fn a_displacement_that_fails_is_an_error() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = write_scene(folder.path(), "scene.usda", SMALL);
    let scene = scene::load(&path, &LoadOptions::default()).expect("a scene");
    let mesh = scene.shapes.iter().find_map(|shape| shape.geometry.mesh());
    let base = Arc::new(Subdivision::new(mesh.expect("a cube"), None));
    let device = Device::new(&DeviceOptions::default()).expect("a device");
    let surface = |height: Box<dyn Fn(usize) -> f32 + Send + Sync>| {
        let asked = AtomicUsize::new(0);
        let map = Function::scalar(move |_| height(asked.fetch_add(1, Ordering::Relaxed)));
        let amount = Amount {
            map: Arc::new(map),
            scale: 1.0,
            bias: 0.0,
        };
        Arc::new(Surface::new(base.clone(), Displacement::Scalar(amount)))
    };
    for method in Method::ALL {
        let build = |surface: &Arc<Surface>| {
            let rates = Rates::uniform(surface, 20);
            let how = How {
                max_error: MaxError::Usual,
                cache: &method.cache(CacheSize(1 << 20)),
                go_on: &|_| true,
                keep: None,
            };
            method.build(surface, &rates, &device, how).map(|built| {
                let mut builder =
                    SceneBuilder::new(&device, method.scene_options()).expect("a scene");
                builder.attach(built.geometry);
                builder.commit(&|_| true).expect("a scene")
            })
        };
        let name = method.name();
        let failing = surface(Box::new(|asked| {
            assert!(asked < 1000, "the height is lost");
            0.1
        }));
        let error = build(&failing).map(|_| ()).expect_err("it panics");
        assert_eq!(error.exit_code(), 1, "{name}: {error}");
        assert!(
            error.to_string().contains("the height is lost"),
            "{name}: {error}"
        );
        let no_number = surface(Box::new(
            |asked| if asked % 7 == 0 { f32::NAN } else { 0.1 },
        ));
        let built = build(&no_number).expect("what is no number counts as 0");
        assert!(!built.bounds().is_empty(), "{name}");
    }
    // Long after it was built.
    let broken = Arc::new(AtomicBool::new(false));
    let breaks = broken.clone();
    let late = surface(Box::new(move |_| {
        assert!(!breaks.load(Ordering::Relaxed), "the height is lost");
        0.1
    }));
    let rates = Rates::uniform(&late, 20);
    let how = How {
        max_error: MaxError::Usual,
        cache: &Method::Cache.cache(CacheSize(1 << 20)),
        go_on: &|_| true,
        keep: None,
    };
    let built = Method::Cache
        .build(&late, &rates, &device, how)
        .expect("it is whole so far");
    let mut builder = SceneBuilder::new(&device, Method::Cache.scene_options()).expect("a scene");
    builder.attach(built.geometry);
    let scene = builder.commit(&|_| true).expect("a scene");
    broken.store(true, Ordering::Relaxed);
    let ray = Ray::new(Vec3::new(0.1, 0.2, 9.0), -Vec3::Z, 0.0);
    for _ in 0..3 {
        assert!(scene.intersect(&ray).is_none(), "what fails is not met");
    }
    let told = scene.take_panic().expect("it is told");
    assert!(told.contains("the height is lost"), "{told}");
    broken.store(false, Ordering::Relaxed);
    assert!(scene.intersect(&ray).is_some(), "and it goes on");
}
