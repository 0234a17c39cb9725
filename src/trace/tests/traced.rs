//! Devices, scenes, triangles, grids and intersectors.

use super::*;
use crate::accel::{Hit, Intersector};
use crate::error::{Error, Result};
use crate::math::{Affine3A, Bounds3, Vec2};
use crate::memory::{Budget, resident};
use proptest::prelude::*;

/// Unit spheres at z = 0 that move by `motion` over the shutter.
struct Spheres {
    centres: Vec<Vec3>,
    motion: Vec3,
    panics: bool,
}

impl Spheres {
    fn still(centres: Vec<Vec3>) -> Self {
        Self {
            centres,
            motion: Vec3::ZERO,
            panics: false,
        }
    }
}

impl Intersector for Spheres {
    fn primitives(&self) -> u32 {
        self.centres.len() as u32
    }
    fn keys(&self) -> u32 {
        2
    }
    fn bounds(&self, p: u32, key: u32) -> Bounds3 {
        let c = self.centres[p as usize] + key as f32 * self.motion;
        Bounds3 {
            min: c - 1.001,
            max: c + 1.001,
        }
    }
    fn intersect(&self, p: u32, ray: &Ray) -> Option<Hit> {
        assert!(!self.panics, "spheres panic");
        let o = ray.origin - self.centres[p as usize] - ray.time * self.motion;
        let (a, b, c) = (
            ray.direction.length_squared(),
            o.dot(ray.direction),
            o.length_squared() - 1.0,
        );
        let root = (b * b - a * c).sqrt();
        let t = [(-b - root) / a, (-b + root) / a]
            .into_iter()
            .find(|&t| t > ray.t_min && t < ray.t_max)?;
        let normal = o + t * ray.direction;
        Some(Hit {
            t,
            face: 100 + p,
            uv: Vec2::new(0.25, 0.5),
            normal,
            error: 1e-3,
        })
    }
    fn memory(&self) -> usize {
        0
    }
}

fn nearest(spheres: &Spheres, ray: &Ray) -> Option<(u32, f32)> {
    (0..spheres.primitives())
        .filter_map(|p| Some((p, spheres.intersect(p, ray)?.t)))
        .min_by(|a, b| a.1.total_cmp(&b.1))
}

#[test]
fn triangles_and_their_motion() {
    let device = device();
    let keys = |z: f32| {
        vec![
            Vec3::new(0.0, 0.0, z),
            Vec3::new(1.0, 0.0, z),
            Vec3::new(0.0, 1.0, z),
        ]
    };
    let geometry = Geometry::triangles(
        &device,
        vec![[0, 1, 2]],
        Arc::new(vec![keys(0.0), keys(4.0)]),
    )
    .expect("one triangle");
    let scene = commit(&device, geometry).expect("it builds");
    let ray = Ray {
        time: 0.25,
        ..down(0.25, 0.5)
    };
    let hit = scene.intersect(&ray).expect("a hit");
    assert!((hit.t - 9.0).abs() < 1e-5 && hit.normal.z > 0.0 && hit.instance.is_none());
    assert!((hit.uv - Vec2::new(0.25, 0.5)).length() < 1e-5);
    let point = scene
        .geometry(0)
        .surface_point(hit.primitive, hit.uv, ray.time);
    assert!((point.position - ray.at(hit.t)).length() < 1e-5);
    assert!(scene.occluded(&ray) && !scene.occluded(&Ray { t_max: 8.0, ..ray }));
    assert!(
        scene.intersect(&Ray { t_min: 9.5, ..ray }).is_none()
            && scene.intersect(&down(0.8, 0.8)).is_none()
    );
    assert!(Geometry::triangles(&device, vec![[0, 1, 3]], Arc::new(vec![keys(0.0)])).is_err());
}

#[test]
fn a_grid_has_one_parameter_square() {
    let device = device();
    let points = sheet(4).points;
    let grid = Grid {
        start_vertex: 0,
        stride: 5,
        width: 5,
        height: 5,
    };
    assert!(
        Geometry::grid(
            &device,
            vec![Grid { height: 6, ..grid }],
            Arc::new(points.clone())
        )
        .is_err()
    );
    let scene = commit(
        &device,
        Geometry::grid(&device, vec![grid], Arc::new(points)).expect("fits"),
    )
    .expect("builds");
    let hit = scene.intersect(&down(1.25, 3.5)).expect("a hit");
    let point = scene.geometry(0).surface_point(0, hit.uv, 0.0);
    assert!(
        (point.position - Vec3::new(1.25, 3.5, 0.0)).length() < 1e-4,
        "{hit:?} {point:?}"
    );
    assert!(
        hit.normal.dot(point.du.cross(point.dv)) > 0.0,
        "{hit:?} {point:?}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]
    #[test]
    fn spheres_are_met_where_they_are(o in prop::array::uniform3(-6.0f32..6.0), d in prop::array::uniform3(-1.0f32..1.0),
                                      time in 0.0f32..1.0) {
        let spheres = Arc::new(Spheres { motion: Vec3::X, ..Spheres::still(vec![Vec3::ZERO, Vec3::Y * 3.0, Vec3::new(-2.0, 0.5, 2.0)]) });
        prop_assume!(Vec3::from(d).length() > 0.1);
        let device = Device::new(&DeviceOptions { threads: 1, ..DeviceOptions::default() }).expect("starts");
        let inner = Arc::new(commit(&device, Geometry::user(&device, Arc::clone(&spheres)).expect("made")).expect("builds"));
        let mut builder = SceneBuilder::new(&device, SceneOptions::default()).expect("made");
        let place = Affine3A::from_scale_rotation_translation(Vec3::new(2.0, 1.0, 0.5), glam::Quat::from_rotation_y(1.0), Vec3::Z);
        let moved = Affine3A::from_translation(Vec3::Y) * place;
        builder.instance(Arc::clone(&inner), &[place, moved]).expect("one level");
        let outer = builder.commit(&|_| true).expect("builds");

        let ray = Ray::new(o.into(), d.into(), time);
        for (scene, local, instance) in [
            (&*inner, ray, None),
            (&outer, ray.transformed(&(Affine3A::from_translation(time * Vec3::Y) * place).inverse()), Some(0)),
        ] {
            let (expected, got) = (nearest(&spheres, &local), scene.intersect(&ray));
            match (expected, got) {
                (None, None) => {}
                (Some((p, t)), Some(hit)) => {
                    prop_assert!((hit.t - t).abs() < 1e-3 * (1.0 + t), "{t} {hit:?}");
                    prop_assert_eq!((hit.primitive, hit.face, hit.instance, hit.error), (p, 100 + p, instance, 1e-3));
                }
                // A ray that grazes may be decided either way by rounding.
                (Some((p, t)), None) => {
                    let normal = spheres.intersect(p, &local).expect("was hit").normal;
                    prop_assert!(normal.dot(local.direction.normalize()).abs() < 0.02, "missed at {t}");
                }
                (None, Some(hit)) => prop_assert!(hit.normal.dot(local.direction.normalize()).abs() < 0.02),
            }
            prop_assert_eq!(scene.occluded(&ray), got.is_some());
        }
    }
}

#[test]
fn a_nearer_triangle_hides_a_sphere() {
    let device = device();
    let mut builder = SceneBuilder::new(&device, SceneOptions::default()).expect("made");
    let sphere = Spheres::still(vec![Vec3::ZERO]);
    builder.attach(Geometry::user(&device, Arc::new(sphere)).expect("made"));
    let at = |x, y| Vec3::new(x, y, 2.0);
    let points = vec![at(-9.0, -9.0), at(9.0, -9.0), at(0.0, 9.0)];
    let id = builder.attach(
        Geometry::triangles(&device, vec![[0, 1, 2]], Arc::new(vec![points])).expect("made"),
    );
    let scene = builder.commit(&|_| true).expect("builds");
    let hit = scene.intersect(&down(0.0, 0.0)).expect("a hit");
    assert_eq!((hit.geometry, hit.face, hit.error), (id, 0, 0.0));
    let below = Ray::new(Vec3::Z * -10.0, Vec3::Z, 0.0);
    assert_eq!(scene.intersect(&below).expect("a hit").face, 100);
    assert!(scene.bounds().max.z >= 2.0 && scene.bounds().min.z <= -1.0);
}

#[test]
fn one_level_of_instances() {
    let device = device();
    let sphere = Spheres::still(vec![Vec3::ZERO]);
    let scene = Arc::new(
        commit(
            &device,
            Geometry::user(&device, Arc::new(sphere)).expect("made"),
        )
        .expect("builds"),
    );
    let mut builder = SceneBuilder::new(&device, SceneOptions::default()).expect("made");
    builder
        .instance(scene, &[Affine3A::IDENTITY])
        .expect("one level");
    let once = Arc::new(builder.commit(&|_| true).expect("builds"));
    assert!(once.instanced(0).is_some());
    let mut builder = SceneBuilder::new(&device, SceneOptions::default()).expect("made");
    assert!(builder.instance(once, &[Affine3A::IDENTITY]).is_err());
}

#[test]
fn an_intersector_that_panics_misses_and_tells() {
    let device = device();
    let sphere = Spheres {
        panics: true,
        ..Spheres::still(vec![Vec3::ZERO])
    };
    let scene = commit(
        &device,
        Geometry::user(&device, Arc::new(sphere)).expect("made"),
    )
    .expect("builds");
    assert!(scene.intersect(&down(0.0, 0.0)).is_none() && !scene.occluded(&down(0.0, 0.0)));
    assert_eq!(scene.take_panic().as_deref(), Some("spheres panic"));
    assert_eq!(scene.take_panic(), None);
}

#[test]
fn a_build_can_be_stopped() {
    let device = device();
    let keys = Arc::new(sheet(300).points);
    let grids: Vec<[u32; 3]> = (0..90_000).map(|i| [i, i + 1, i + 301]).collect();
    let mut builder = SceneBuilder::new(&device, SceneOptions::default()).expect("made");
    builder.attach(Geometry::triangles(&device, grids, keys).expect("made"));
    assert!(matches!(
        builder.commit(&|_| false),
        Err(Error::Interrupted)
    ));
}

#[test]
fn memory_is_counted_and_given_back() {
    let device = device();
    let before = device.memory();
    let scene = commit(
        &device,
        Geometry::subdivision(&device, arc(cube()), options(32.0)).expect("made"),
    )
    .expect("builds");
    assert!(device.memory() > before + 10_000 && device.peak_memory() >= device.memory());
    drop(scene);
    assert_eq!(device.memory(), before);
}

/// How much is resident is a matter of all tests that run beside this one, too, and they free memory: a budget that leaves
/// next to nothing may come to leave some hundred megabytes. What is refused is over four gigabytes. `tests/budget.rs`
/// looks from outside.
#[test]
fn a_memory_budget_is_kept() {
    let all = Budget::new(resident().expect("Linux tells") + (4 << 20));
    let device = Device::new(&DeviceOptions {
        memory_budget: all,
        ..DeviceOptions::default()
    })
    .expect("starts");
    let built = Geometry::subdivision(&device, arc(sheet(160)), options(64.0))
        .and_then(|g| commit(&device, g));
    assert!(matches!(built.map(|_| ()), Err(Error::Memory { .. })));
    let peak = device.peak_memory();
    assert!(peak < 1 << 30, "{peak}");
}

/// Whichever allocation of Embree's is refused, it is an error that says so, all is given back, and the device goes on.
#[test]
fn any_allocation_of_embrees_may_fail() {
    let kinds: [fn(&Device) -> Result<Geometry>; 3] = [
        |device| Geometry::subdivision(device, arc(sheet(8)), options(8.0)),
        |device| {
            let (points, triangles) = strip(2000);
            Geometry::triangles(device, triangles, Arc::new(vec![points]))
        },
        |device| {
            let (points, _) = strip(64);
            let grid = Grid {
                start_vertex: 0,
                stride: 2,
                width: 2,
                height: 64,
            };
            Geometry::grid(device, vec![grid], Arc::new(vec![points]))
        },
    ];
    for (kind, make) in kinds.into_iter().enumerate() {
        let mut refused = 0;
        for time in 0.. {
            let budget = Budget::refusing_once(usize::MAX, time);
            let device = Device::new(&DeviceOptions {
                memory_budget: budget.clone(),
                threads: 1,
                ..DeviceOptions::default()
            })
            .expect("starts");
            let before = device.memory();
            let built = make(&device).and_then(|g| commit(&device, g));
            let was_refused = budget.asked() > time;
            match built {
                Ok(scene) => {
                    let hit = scene.intersect(&down(0.5, 0.5));
                    assert!(hit.is_some() || kind != 1, "kind {kind}, time {time}");
                    drop(scene);
                }
                Err(error) => {
                    assert_eq!(error.exit_code(), 4, "kind {kind}, time {time}: {error}");
                    assert!(was_refused, "kind {kind}, time {time}: {error}");
                    refused += 1;
                }
            }
            assert_eq!(device.memory(), before, "kind {kind}, time {time}");
            if !was_refused {
                break;
            }
            make(&device)
                .and_then(|g| commit(&device, g))
                .expect("the next one is built");
        }
        assert!(refused > 1, "kind {kind}: {refused}");
    }
}

/// Points in pairs along x, and the triangles between.
fn strip(pairs: u32) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let points = (0..pairs)
        .flat_map(|i| [0.0, 1.0].map(|y| Vec3::new(i as f32, y, 0.0)))
        .collect();
    let triangles = (1..pairs)
        .flat_map(|i| [[2 * i - 2, 2 * i, 2 * i - 1], [2 * i - 1, 2 * i, 2 * i + 1]])
        .collect();
    (points, triangles)
}

#[test]
fn an_empty_scene_is_missed() {
    let device = device();
    let scene = SceneBuilder::new(&device, SceneOptions::default())
        .and_then(|b| b.commit(&|_| true))
        .expect("builds");
    assert!(scene.intersect(&down(0.0, 0.0)).is_none() && scene.bounds().is_empty());
    assert!(
        device
            .version()
            .starts_with(&format!("{}.", embree4_sys::embree_version()[0]))
    );
}
