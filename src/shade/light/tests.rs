//! Sampling against closed forms, against the intersectors, and against itself.

use std::f32::consts::PI;

use super::*;
use crate::accel::Intersector;
use crate::math::{DVec3, Ray, Vec2, Vec4};
use crate::scene::{Channels, Shaping, TextureMap, Transform2d};

const N: u32 = 300;

fn light(kind: LightKind, world_from_light: DAffine3) -> scene::Light {
    scene::Light {
        path: "/L".into(),
        kind,
        world_from_light,
        color: Vec3::new(2.0, 1.0, 0.5),
        normalize: false,
        diffuse: 1.0,
        specular: 1.0,
        texture: None,
        shaping: None,
    }
}

fn lights(all: &[scene::Light]) -> Lights {
    let bounds = Bounds3::of([Vec3::splat(-1.0), Vec3::ONE]);
    Lights::new(all, &[], bounds).0
}

fn at(x: f64, y: f64, z: f64) -> DAffine3 {
    DAffine3::from_translation(DVec3::new(x, y, z))
}

/// Scaled, sheared, turned, and mirrored if asked for.
fn crooked(mirror: bool) -> DAffine3 {
    let turned = DAffine3::from_rotation_x(0.4) * DAffine3::from_rotation_y(-0.3);
    let mut shear = DAffine3::from_scale(DVec3::new(1.3, 0.6, if mirror { -0.8 } else { 0.8 }));
    shear.matrix3.y_axis.x = 0.35;
    at(0.3, -0.2, 3.0) * turned * shear
}

fn grid() -> impl Iterator<Item = [f32; 2]> {
    (0..N * N).map(|i| [i % N, i / N].map(|k| (k as f32 + 0.5) / N as f32))
}

fn samples(lights: &Lights, p: Vec3) -> impl Iterator<Item = LightSample> + '_ {
    grid().filter_map(move |u| lights.sample(p, 0.5, u))
}

fn mean(values: impl Iterator<Item = f32>) -> f32 {
    (values.map(f64::from).sum::<f64>() / f64::from(N * N)) as f32
}

/// Of a surface at `p` with normal `n`, in the red channel.
fn irradiance(lights: &Lights, p: Vec3, n: Vec3) -> f32 {
    mean(samples(lights, p).map(|s| s.radiance.x * s.wi.dot(n).max(0.0) / s.pdf))
}

fn close(a: f32, b: f32, relative: f32) {
    assert!((a - b).abs() <= relative * b.abs(), "{a} is not {b}");
}

fn area_kinds() -> [LightKind; 4] {
    [
        LightKind::Rect {
            width: 2.0,
            height: 1.0,
        },
        LightKind::Disk { radius: 0.7 },
        LightKind::Sphere { radius: 0.8 },
        LightKind::Cylinder {
            radius: 0.5,
            length: 2.0,
        },
    ]
}

fn poses() -> [DAffine3; 4] {
    [
        at(0.2, 0.1, 2.0),
        at(0.2, 0.1, 2.0) * DAffine3::from_rotation_x(0.5),
        crooked(false),
        crooked(true),
    ]
}

/// Where a ray meets the first light, however it is handed to Embree.
fn meet(shapes: &LightShapes, ray: &Ray) -> Option<Hit> {
    if shapes.primitives() > 0 {
        return shapes.intersect(0, ray);
    }
    let (triangles, points) = shapes.triangles();
    let d = ray.direction.as_dvec3();
    (0..).zip(triangles).find_map(|(i, corners)| {
        let [a, b, c] = corners.map(|v| (points[v as usize] - ray.origin).as_dvec3());
        let volume = d.dot((b - a).cross(c - a));
        let [wa, wb, wc] = [(b, c), (c, a), (a, b)].map(|(p, q)| d.dot(p.cross(q)) / volume);
        let t = (a.dot((b - a).cross(c - a)) / volume) as f32;
        let inside = wa >= 0.0 && wb >= 0.0 && wc >= 0.0;
        (inside && t > ray.t_min && t < ray.t_max)
            .then(|| shapes.on_triangle(i, t, Vec2::new(wb as f32, wc as f32)))
    })
}

fn bounds(shapes: &LightShapes) -> Bounds3 {
    if shapes.primitives() > 0 {
        shapes.bounds(0, 0)
    } else {
        Bounds3::of(shapes.triangles().1)
    }
}

#[test]
fn samples_hit_the_light_where_they_say_with_the_density_that_emitted_says() {
    for kind in area_kinds() {
        for pose in poses() {
            let all = lights(&[light(kind, pose)]);
            let shapes = all.shapes().expect("an area light");
            let bounds = bounds(shapes);
            for p in [
                Vec3::ZERO,
                Vec3::new(3.0, -1.0, 0.5),
                Vec3::new(0.1, 0.1, -200.0),
            ] {
                let (mut met, mut missed) = (0, 0);
                for s in samples(&all, p).step_by(7) {
                    close(s.wi.length(), 1.0, 1e-5);
                    let ray = Ray::new(p, s.wi, 0.0);
                    let short = Ray {
                        t_max: s.distance * (1.0 - 1e-4),
                        ..ray
                    };
                    assert!(meet(shapes, &short).is_none(), "{kind:?}");
                    let Some(hit) = meet(shapes, &ray) else {
                        missed += 1; // Rounding at the silhouette
                        continue;
                    };
                    met += 1;
                    close(hit.t, s.distance, 2e-3);
                    let q = ray.at(hit.t);
                    let off = (q - q.clamp(bounds.min, bounds.max)).length();
                    assert!(
                        off <= 5e-7 * (p.length() + q.length()),
                        "{kind:?} {off} of {q}"
                    );
                    let (radiance, pdf) = all.emitted(0, p, &hit, s.wi);
                    assert_eq!(radiance, s.radiance);
                    // Edge-on, the density of area sampling has a pole, and rounding of the point moves it
                    let edge = hit.normal.normalize().dot(s.wi).abs();
                    if edge > 0.05 {
                        close(pdf, s.pdf, 2e-3 + 5e-5 / (edge * edge));
                    }
                }
                assert!(missed * 200 <= met, "{kind:?}: {missed} of {met} missed");
            }
        }
    }
}

/// The solid angle as the rays see it: a fine grid of directions around the light.
fn seen_solid_angle(lights: &Lights, p: Vec3) -> f32 {
    let shapes = lights.shapes().expect("an area light");
    let bounds = bounds(shapes);
    let axis = (bounds.centre() - p).normalize();
    let frame = crate::math::Frame::around(axis);
    let half = (0.5 * bounds.extent().length() / (bounds.centre() - p).length())
        .min(1.0)
        .asin();
    let versine = 1.0 - half.cos();
    let part = mean(grid().map(|u| {
        let wi = distant::in_cone(&frame, versine, u);
        let hit = meet(shapes, &Ray::new(p, wi, 0.0));
        f32::from(u8::from(hit.is_some_and(|h| h.normal.dot(wi) < 0.0)))
    }));
    part * 2.0 * PI * versine
}

#[test]
fn the_mean_of_one_over_the_density_is_the_solid_angle() {
    for kind in area_kinds() {
        for pose in poses() {
            let all = lights(&[light(kind, pose)]);
            for p in [Vec3::ZERO, Vec3::new(2.0, -1.0, 0.5)] {
                let sampled = mean(samples(&all, p).map(|s| 1.0 / s.pdf));
                let seen = seen_solid_angle(&all, p);
                assert!(
                    (sampled - seen).abs() < 0.01 * seen + 1e-4,
                    "{kind:?}: {sampled} {seen}"
                );
            }
        }
    }
}

#[test]
fn irradiances_have_their_closed_forms() {
    // A disk at height 2 shining down: pi L sin^2
    let all = lights(&[light(LightKind::Disk { radius: 1.5 }, at(0.0, 0.0, 2.0))]);
    let sin2 = 1.5 * 1.5 / (1.5 * 1.5 + 4.0);
    close(irradiance(&all, Vec3::ZERO, Vec3::Z), PI * 2.0 * sin2, 1e-3);
    assert!(
        all.sample(Vec3::new(0.0, 0.0, 3.0), 0.5, [0.5; 2])
            .is_none()
    );
    // A sphere: pi L (r / d)^2, far ones too
    for (r, d) in [(0.5_f32, 2.0_f32), (1.0, 1.01), (0.01, 1000.0)] {
        let all = lights(&[light(
            LightKind::Sphere { radius: r },
            at(0.0, 0.0, d.into()),
        )]);
        let wanted = PI * 2.0 * (r / d) * (r / d);
        close(irradiance(&all, Vec3::ZERO, Vec3::Z), wanted, 1e-3);
    }
    assert!(
        lights(&[light(LightKind::Sphere { radius: 1.0 }, at(0.0, 0.0, 0.5))])
            .sample(Vec3::ZERO, 0.5, [0.5; 2])
            .is_none()
    );
    // A rectangle over one of its corners: Lambert's formula for a parallel one; near and far
    for (a, b, h) in [
        (1.0_f32, 2.0_f32, 1.5_f32),
        (1.0, 1.0, 0.01),
        (0.1, 0.2, 50.0),
    ] {
        let kind = LightKind::Rect {
            width: a,
            height: b,
        };
        let all = lights(&[light(
            kind,
            at(0.5 * f64::from(a), 0.5 * f64::from(b), h.into()),
        )]);
        let (x, y) = (a / h, b / h);
        let (rx, ry) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
        let factor = (x / rx * (y / rx).atan() + y / ry * (x / ry).atan()) / (2.0 * PI);
        close(
            irradiance(&all, Vec3::ZERO, Vec3::Z),
            PI * 2.0 * factor,
            3e-3,
        );
    }
}

#[test]
fn a_distant_light_gives_its_colour_as_irradiance_if_normalized() {
    let pose = DAffine3::from_rotation_y(0.3);
    let facing = pose.matrix3.z_axis.as_vec3();
    for angle in [0.53, 40.0] {
        let mut sun = light(LightKind::Distant { angle }, pose);
        sun.normalize = true;
        let all = lights(std::slice::from_ref(&sun));
        close(irradiance(&all, Vec3::ZERO, facing), 2.0, 1e-3);
        let mut differ = 0;
        for s in samples(&all, Vec3::ZERO).step_by(11) {
            let (radiance, pdf) = all.environment(Vec3::ZERO, s.wi);
            differ += u32::from((radiance, pdf) != (s.radiance, s.pdf));
        }
        assert!(differ < 10, "{differ}"); // On the cone's border
        assert_eq!(all.environment(Vec3::ZERO, -facing).1, 0.0);
        sun.normalize = false;
        assert_eq!(lights(&[sun]).environment(Vec3::ZERO, facing).0.x, 2.0);
    }
    let tiny = lights(&[light(LightKind::Distant { angle: 1e-12 }, pose)]);
    let s = tiny.sample(Vec3::ZERO, 0.5, [0.5; 2]).expect("a sample");
    assert!(s.pdf.is_infinite() && s.radiance.x < 1e-20);
    for normalize in [false, true] {
        let mut sun = light(LightKind::Distant { angle: 0.0 }, pose);
        sun.normalize = normalize;
        // With a second one, to see the choice divided out
        let all = lights(&[sun.clone(), sun]);
        let s = all.sample(Vec3::ZERO, 0.9, [0.5; 2]).expect("a sample");
        assert_eq!((s.light, s.pdf), (1, f32::INFINITY));
        close(s.radiance.x, 4.0, 1e-5);
        close(s.wi.dot(facing), 1.0, 1e-5);
        assert_eq!(all.environment(Vec3::ZERO, facing), (Vec3::ZERO, 0.0));
    }
}

#[test]
fn normalize_divides_by_the_area_in_the_world() {
    // Irradiance far away in front of a one-sided light of colour 2: 2 / d^2
    let wide = DAffine3::from_scale(DVec3::new(2.0, 3.0, 1.0));
    for kind in [
        LightKind::Rect {
            width: 0.3,
            height: 0.2,
        },
        LightKind::Disk { radius: 0.1 },
    ] {
        let mut lamp = light(kind, at(0.0, 0.0, 100.0) * wide);
        lamp.normalize = true;
        close(
            irradiance(&lights(&[lamp]), Vec3::ZERO, Vec3::Z),
            2e-4,
            2e-3,
        );
    }
    // A ball shows a quarter of its area; so does any convex body on average, and a tube 1 / pi sideways
    let mut ball = light(LightKind::Sphere { radius: 0.3 }, at(0.0, 0.0, 100.0));
    ball.normalize = true;
    close(
        irradiance(&lights(&[ball.clone()]), Vec3::ZERO, Vec3::Z),
        0.5e-4,
        2e-3,
    );
    let tube = LightKind::Cylinder {
        radius: 0.1,
        length: 1.0,
    };
    ball.kind = tube;
    close(
        irradiance(&lights(&[ball.clone()]), Vec3::ZERO, Vec3::Z),
        2e-4 / PI,
        2e-3,
    );
    // An oblate spheroid with axes 1, 1, 1/2: 2 pi (1 + (1 - e^2) / e atanh e)
    ball.kind = LightKind::Sphere { radius: 1.0 };
    ball.world_from_light = DAffine3::from_scale(DVec3::new(1.0, 1.0, 0.5));
    let e = 0.75_f32.sqrt();
    let area = 2.0 * PI * (1.0 + 0.25 / e * e.atanh());
    let all = lights(&[ball]);
    let hit = Hit {
        t: 1.0,
        face: 0,
        uv: Vec2::ZERO,
        normal: Vec3::Z,
        error: 0.0,
    };
    let (radiance, _) = all.emitted(0, Vec3::new(0.0, 0.0, 2.0), &hit, -Vec3::Z);
    close(radiance.x, 2.0 / area, 1e-4);
}

/// 8 x 4 texels, bright at one place; nearest lookup.
struct Spots;

impl Radiance for Spots {
    fn eval(&self, st: Vec2) -> Vec4 {
        let [x, y] = [st.x * 8.0, (1.0 - st.y) * 4.0].map(|v| v.max(0.0) as u32);
        self.texel(x.min(7), y.min(3))
    }
    fn size(&self) -> [u32; 2] {
        [8, 4]
    }
    fn texel(&self, x: u32, y: u32) -> Vec4 {
        let v = match (x, y) {
            (2, 1) => 40.0,
            (_, 0) => 3.0,
            (0, _) => 0.0,
            _ => 0.5,
        };
        Vec4::new(v, v, v, 1.0)
    }
}

fn spots() -> (Vec<Option<Arc<dyn Radiance>>>, TextureMap) {
    let map = TextureMap {
        texture: 0,
        primvar: String::new(),
        transform: Transform2d::default(),
        channels: Channels::Rgb,
        scale: Vec4::ONE,
        bias: Vec4::ZERO,
        fallback: Vec4::splat(7.0),
    };
    (vec![Some(Arc::new(Spots))], map)
}

#[test]
fn a_dome_samples_its_picture() {
    let (textures, map) = spots();
    for pose in [DAffine3::IDENTITY, crooked(true)] {
        let mut sky = light(LightKind::Dome, pose);
        sky.texture = Some(map.clone());
        let all = Lights::new(&[sky.clone()], &textures, Bounds3::EMPTY).0;
        // The density integrates to 1, and both estimators of the mean radiance agree
        let sphere = || {
            grid().map(|[a, b]| {
                let z = 1.0 - 2.0 * a;
                let (sin, cos) = (2.0 * PI * b).sin_cos();
                let r = (1.0 - z * z).sqrt();
                Vec3::new(r * cos, z, r * sin)
            })
        };
        close(
            4.0 * PI * mean(sphere().map(|w| all.environment(w, w).1)),
            1.0,
            0.01,
        );
        let even = 4.0 * PI * mean(sphere().map(|w| all.environment(w, w).0.x));
        close(
            mean(samples(&all, Vec3::ZERO).map(|s| s.radiance.x / s.pdf)),
            even,
            0.01,
        );
        let mut differ = 0;
        for s in samples(&all, Vec3::ZERO).step_by(13) {
            let (_, pdf) = all.environment(Vec3::ZERO, s.wi);
            differ += u32::from((pdf - s.pdf).abs() > 1e-3 * s.pdf);
        }
        assert!(differ < 20, "{differ}"); // On the cells' borders
        let fallback = Lights::new(&[sky], &[None], Bounds3::EMPTY).0;
        assert_eq!(fallback.environment(Vec3::ZERO, Vec3::X).0.x, 14.0);
    }
}

#[test]
fn a_dome_lies_as_openexr_says() {
    for (direction, st) in [
        (Vec3::Z, [0.5, 0.5]),
        (Vec3::X, [0.25, 0.5]),
        (Vec3::NEG_X, [0.75, 0.5]),
        (Vec3::new(1e-6, 0.0, -1.0), [0.0, 0.5]),
    ] {
        let [s, t] = dome::latlong(direction);
        assert!(
            (s - st[0]).abs() < 1e-5 && (t - st[1]).abs() < 1e-5,
            "{direction}"
        );
    }
    assert_eq!(dome::latlong(Vec3::Y)[1], 1.0);
    assert_eq!(dome::latlong(Vec3::NEG_Y)[1], 0.0);
}

#[test]
fn an_even_dome_gives_pi_times_its_radiance() {
    let all = Lights::default_dome(Vec3::ONE);
    close(
        irradiance(&all, Vec3::ZERO, Vec3::new(0.6, 0.0, 0.8)),
        PI,
        2e-3,
    );
    assert_eq!(
        (all.count(), all.is_empty(), all.multipliers(0)),
        (1, false, [1.0; 2])
    );
}

#[test]
fn a_rectangles_picture_reads_right_from_the_front() {
    let (textures, map) = spots();
    let kind = LightKind::Rect {
        width: 8.0,
        height: 4.0,
    };
    let mut screen = light(kind, at(0.0, 0.0, 10.0));
    screen.texture = Some(map);
    let all = Lights::new(&[screen], &textures, Bounds3::EMPTY).0;
    let shapes = all.shapes().expect("an area light");
    let look = |x: f32, y: f32| {
        let p = Vec3::new(x, y, 0.0);
        let hit = meet(shapes, &Ray::new(p, Vec3::Z, 0.0)).expect("a hit");
        all.emitted(0, p, &hit, Vec3::Z).0.x / 2.0
    };
    // Who looks along +Z with +Y up has +X on the left: texel (2, 1) is left of the middle, and above it
    assert_eq!(look(1.5, 0.5), 40.0);
    assert_eq!(look(-1.5, 1.5), 3.0);
    assert_eq!(look(3.5, -0.5), 0.0);
}

#[test]
fn the_choice_is_part_of_the_density() {
    let all = lights(&[
        light(LightKind::Sphere { radius: 0.5 }, at(0.0, 0.0, 3.0)),
        light(LightKind::Sphere { radius: 0.0 }, at(0.0, 0.0, 3.0)),
        light(LightKind::Disk { radius: 3.0 }, at(0.0, 1.0, 4.0)),
        light(LightKind::Distant { angle: 0.0 }, at(0.0, 0.0, 0.0)),
        light(LightKind::Dome, at(0.0, 0.0, 0.0)),
    ]);
    assert_eq!((all.count(), all.light_of(1)), (4, 2));
    let wanted = PI * 2.0 * (0.25 / 9.0)
        + 2.0
        + PI * 2.0
        + irradiance(
            &lights(&[light(LightKind::Disk { radius: 3.0 }, at(0.0, 1.0, 4.0))]),
            Vec3::ZERO,
            Vec3::Z,
        );
    let n = 400;
    let mut sum = 0.0;
    for i in 0..n {
        let u_pick = (i as f32 + 0.5) / n as f32;
        for u in grid().step_by(101) {
            if let Some(s) = all.sample(Vec3::ZERO, u_pick, u) {
                let weight = if s.pdf.is_finite() { 1.0 / s.pdf } else { 1.0 };
                sum += f64::from(s.radiance.x * s.wi.z.max(0.0) * weight);
            }
        }
    }
    let count = f64::from(n) * grid().step_by(101).count() as f64;
    close((sum / count) as f32, wanted, 0.02);
}

#[test]
fn shaping_cuts_a_cone() {
    let mut spot = light(LightKind::Sphere { radius: 0.1 }, at(0.0, 0.0, 0.0));
    spot.shaping = Some(Shaping {
        focus: 2.0,
        focus_tint: Vec3::ZERO,
        cone_angle: 30.0,
        cone_softness: 0.5,
    });
    let all = lights(&[spot]);
    let seen = |degrees: f32| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let p = 5.0 * Vec3::new(sin, 0.0, -cos);
        all.sample(p, 0.5, [0.0; 2]).expect("a sample").radiance.x / (2.0 * cos * cos)
    };
    close(seen(0.0), 1.0, 1e-4);
    close(seen(14.0), 1.0, 1e-4);
    close(seen(22.5), 0.5, 1e-2);
    assert_eq!(seen(31.0), 0.0);
}

#[test]
fn a_point_on_a_light_does_not_meet_it() {
    for kind in area_kinds() {
        for pose in poses() {
            let all = lights(&[light(kind, pose)]);
            let shapes = all.shapes().expect("an area light");
            let p = Vec3::new(0.1, -0.4, -1.0);
            for s in samples(&all, p).step_by(37) {
                let Some(hit) = meet(shapes, &Ray::new(p, s.wi, 0.0)) else {
                    continue;
                };
                let on = p + hit.t * s.wi;
                // What starts on triangles keeps clear of them by the error of where it stands.
                let curved = shapes.primitives() > 0;
                if curved && hit.normal.normalize().dot(s.wi).abs() > 0.02 {
                    let away = meet(shapes, &Ray::new(on, hit.normal, 0.0));
                    assert!(away.is_none(), "{kind:?} {away:?}");
                }
                let here = all.sample(on, 0.5, [0.3; 2]);
                assert!(here.is_none_or(|s| s.pdf.is_finite() && s.wi.is_finite()));
            }
        }
    }
}

#[test]
fn two_skies_are_sampled_as_their_parts_say() {
    let mut sun = light(LightKind::Distant { angle: 60.0 }, at(0.0, 0.0, 0.0));
    sun.normalize = true;
    let all = lights(&[light(LightKind::Dome, at(0.0, 0.0, 0.0)), sun]);
    for u_pick in [0.1, 0.9] {
        let s = all
            .sample(Vec3::ZERO, u_pick, [0.4, 0.3])
            .expect("a sample");
        let part = all
            .environment_parts(Vec3::ZERO, s.wi)
            .find(|e| e.light == s.light);
        let part = part.expect("the light that was sampled");
        assert_eq!(part.radiance, s.radiance);
        close(part.pdf, s.pdf, 1e-4);
    }
    let parts = all.environment_parts(Vec3::ZERO, Vec3::Z);
    let sum = parts.fold(Vec3::ZERO, |sum, e| sum + e.radiance);
    assert_eq!(all.environment(Vec3::ZERO, Vec3::Z).0, sum);
}

#[test]
fn black_and_broken_lights_are_harmless() {
    let mut black = light(LightKind::Dome, at(0.0, 0.0, 0.0));
    black.color = Vec3::ZERO;
    let mut flat = light(LightKind::Disk { radius: 1.0 }, at(0.0, 0.0, 0.0));
    flat.world_from_light = DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0));
    let sizeless = light(LightKind::Sphere { radius: f32::NAN }, at(0.0, 0.0, 0.0));
    let (all, warnings) = Lights::new(&[black, flat, sizeless], &[], Bounds3::EMPTY);
    assert_eq!((all.count(), warnings.iter().count()), (1, 2));
    assert!(all.sample(Vec3::ZERO, 0.5, [0.5; 2]).is_none() && all.shapes().is_none());
    assert_eq!(all.environment(Vec3::ZERO, Vec3::X), (Vec3::ZERO, 0.0));
    assert!(all.memory() > 0 && Lights::new(&[], &[], Bounds3::EMPTY).0.is_empty());
}
