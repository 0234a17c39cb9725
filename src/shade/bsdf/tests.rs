use super::*;
use crate::shade::sampler::Sampler;
use std::f32::consts::PI;

fn upright(params: &SurfaceParams) -> Bsdf {
    Bsdf::new(params, Frame::around(Vec3::Z), Vec3::Z)
}

fn slanted(cos: f32) -> Vec3 {
    Vec3::new((1.0 - cos * cos).sqrt(), 0.0, cos)
}

/// A grid over everything that could break the bound.
fn grid() -> impl Iterator<Item = SurfaceParams> {
    materials([0.0, 0.3, 0.6, 1.0])
}

fn white(metallic: f32, ior: f32, roughness: f32, clearcoat: f32) -> SurfaceParams {
    SurfaceParams {
        diffuse_color: Vec3::ONE,
        metallic,
        ior,
        roughness,
        clearcoat,
        clearcoat_roughness: 0.3,
        ..SurfaceParams::default()
    }
}

fn materials<const N: usize>(roughnesses: [f32; N]) -> impl Iterator<Item = SurfaceParams> {
    roughnesses.into_iter().flat_map(move |roughness| {
        [
            white(0.0, 1.5, roughness, 0.0),
            white(0.0, 1.5, roughness, 1.0),
            white(0.0, 3.0, roughness, 0.0),
            white(0.5, 1.0, roughness, 0.5),
            white(1.0, 1.5, roughness, 0.0),
            white(1.0, 1.5, roughness, 1.0),
            SurfaceParams {
                specular_workflow: true,
                specular_color: Vec3::new(1.0, 0.5, 0.0),
                ..white(0.0, 1.5, roughness, 0.0)
            },
        ]
    })
}

/// What a white sky shows of the surface towards the angle with this cosine, by quadrature: Fibonacci lattices in
/// each lobe's own coordinates, in which no lobe is narrow, and in the fourth root of the cosine, for what happens
/// near the horizon, weighed by the balance heuristic.
fn reflected(bsdf: &Bsdf, cos: f32) -> Vec3 {
    const SAMPLES: u32 = 2584;
    const STEP: u32 = 1597;
    let lattice =
        || (0..SAMPLES).map(|k| [k * STEP % SAMPLES, k].map(|n| (n as f32 + 0.5) / SAMPLES as f32));
    let near_horizon = |cos: f32| 1.0 / (2.0 * PI * 4.0 * cos.powf(0.75));
    let wo = slanted(cos);
    let viewed = bsdf.seen_from(wo).expect("above the horizon");
    let mut before = 0.0;
    let mut sum = glam::DVec3::ZERO;
    for pick in viewed.pick {
        let lobe = before + 0.5 * pick;
        before += pick;
        if pick == 0.0 {
            continue;
        }
        let one: glam::DVec3 = lattice()
            .filter_map(|[u, v]| bsdf.sample(wo, [lobe, u, v]))
            .map(|s| (s.value / (s.pdf + near_horizon(s.wi.z))).as_dvec3())
            .sum();
        sum += f64::from(pick) * one;
    }
    let rest: glam::DVec3 = lattice()
        .map(|[u, v]| {
            let (cos, (sin_phi, cos_phi)) = (v.powi(4), (2.0 * PI * u).sin_cos());
            let sin = (1.0 - cos * cos).sqrt();
            let value = bsdf.eval_all(wo, Vec3::new(sin * cos_phi, sin * sin_phi, cos));
            (value.total() / (value.pdf + near_horizon(cos))).as_dvec3()
        })
        .sum();
    ((sum + rest) / f64::from(SAMPLES)).as_vec3()
}

/// The mean weight of `n` samples, towards the angle with this cosine.
fn furnace(bsdf: &Bsdf, cos: f32, n: u32) -> Vec3 {
    let wo = slanted(cos);
    let sum: Vec3 = (0..n)
        .filter_map(|k| {
            let u = Sampler::new([0, 0], k, 0).set(0);
            bsdf.sample(wo, [u[2], u[0], u[1]])
        })
        .map(|s| s.value / s.pdf)
        .sum();
    sum / n as f32
}

#[test]
fn lambert_reflects_exactly_its_albedo() {
    let albedo = Vec3::new(0.25, 0.5, 0.75);
    let bsdf = upright(&SurfaceParams::lambert(albedo));
    for k in 0..100 {
        let u = Sampler::new([0, 0], k, 0).set(0);
        let s = bsdf
            .sample(slanted(0.3), [u[2], u[0], u[1]])
            .expect("Lambert reflects everywhere");
        assert!((s.value / s.pdf - albedo).length() < 1e-6);
        assert!((s.value - albedo * s.wi.z / PI).length() < 1e-6);
    }
    assert!((bsdf.albedo(slanted(0.3)) - albedo).length() < 1e-6);
    assert_eq!(
        bsdf.eval_split(Vec3::Z, slanted(0.5))[1],
        Vec3::ZERO,
        "nothing specular"
    );
}

#[test]
fn nothing_reflects_more_than_it_gets() {
    // The lattice's own error, found by one four times as fine.
    const NOISE: f32 = 2e-4;
    let roughnesses = [0.0, 0.035, 0.06, 0.1, 0.17, 0.3, 0.45, 0.6, 0.8, 0.93, 1.0];
    let coats = [0.0, 0.01, 0.1, 1.0];
    let coated = coats.into_iter().flat_map(|clearcoat_roughness| {
        [0.05, 1.0].map(|roughness| SurfaceParams {
            clearcoat_roughness,
            ..white(0.0, 1.3, roughness, 1.0)
        })
    });
    let mut most = 0.0_f32;
    for params in materials(roughnesses).chain(coated) {
        let bsdf = upright(&params);
        for cos in [
            1e-3, 5e-3, 0.01, 0.02, 0.04, 0.07, 0.12, 0.2, 0.35, 0.6, 0.85, 1.0,
        ] {
            let found = reflected(&bsdf, cos);
            assert!(
                found.max_element() <= 1.0 + NOISE,
                "{params:?} {cos}: {found}"
            );
            most = most.max(found.max_element());
        }
    }
    println!("at most {most}");
}

/// The loss that the module states for roughness 1, and what a mirror loses.
#[test]
fn white_surfaces_lose_little() {
    for (what, metallic, clearcoat, roughness, loss) in [
        ("metal", 1.0, 0.0, 1.0, 1e-3),
        ("dielectric", 0.0, 0.0, 1.0, 1e-3),
        ("coated metal", 1.0, 1.0, 1.0, 8e-3),
        ("coated dielectric", 0.0, 1.0, 1.0, 8e-3),
        ("smooth metal", 1.0, 0.0, 0.0, 7e-3),
        ("smooth dielectric", 0.0, 0.0, 0.0, 3e-3),
    ] {
        let bsdf = upright(&SurfaceParams {
            clearcoat_roughness: 1.0,
            ..white(metallic, 1.5, roughness, clearcoat)
        });
        let cosines = (1..=100).map(|k| k as f32 / 100.0);
        let lost: Vec<f32> = cosines.map(|cos| 1.0 - reflected(&bsdf, cos).x).collect();
        let worst = lost.iter().copied().fold(0.0, f32::max);
        let mean: f32 = (lost.iter().zip(1..).map(|(l, k)| l * k as f32)).sum::<f32>() / 5050.0;
        println!("{what}: at most {worst}, on average {mean}");
        assert!(worst < loss, "{what}: {worst}");
    }
}

#[test]
fn the_albedo_is_what_a_furnace_shows() {
    for params in grid().filter(|p| p.clearcoat < 0.1) {
        let bsdf = upright(&params);
        for cos in [0.2, 0.6, 1.0] {
            let found = furnace(&bsdf, cos, 2048);
            let said = bsdf.albedo(slanted(cos));
            assert!(
                (found - said).length() < 0.02,
                "{params:?} {cos}: {found} {said}"
            );
        }
    }
}

#[test]
fn a_white_metal_loses_nothing() {
    for roughness in [0.1, 0.4, 0.7, 1.0] {
        let bsdf = upright(&SurfaceParams {
            diffuse_color: Vec3::ONE,
            metallic: 1.0,
            roughness,
            ..SurfaceParams::default()
        });
        for cos in [0.2, 0.5, 0.9] {
            let found = furnace(&bsdf, cos, 2048).x;
            assert!((found - 1.0).abs() < 0.015, "{roughness} {cos}: {found}");
        }
    }
}

/// The integral of `f` over the hemisphere, on a grid even in solid angle.
fn hemisphere(n: u32, mut f: impl FnMut(Vec3) -> f64) -> f64 {
    let mut sum = 0.0;
    for j in 0..n {
        for k in 0..4 * n {
            let cos = (j as f32 + 0.5) / n as f32;
            let phi = 2.0 * PI * (k as f32 + 0.5) / (4 * n) as f32;
            let sin = (1.0 - cos * cos).sqrt();
            sum += f(Vec3::new(sin * phi.cos(), sin * phi.sin(), cos));
        }
    }
    sum * 2.0 * std::f64::consts::PI / f64::from(4 * n * n)
}

#[test]
fn samples_follow_the_density() {
    for params in grid().filter(|p| p.roughness > 0.5) {
        let bsdf = upright(&params);
        for cos in [0.3, 0.9] {
            let wo = slanted(cos);
            // 4 x 8 cells of equal solid angle: expected by integration, found by sampling.
            let cell = |wi: Vec3| {
                let turn = wi.y.atan2(wi.x) / (2.0 * PI) + 0.5;
                ((wi.z * 4.0) as usize).min(3) * 8 + ((turn * 8.0) as usize).min(7)
            };
            let mut expected = [0.0_f64; 32];
            let n = 96;
            let whole = hemisphere(n, |wi| {
                let pdf = f64::from(bsdf.pdf(wo, wi));
                expected[cell(wi)] += pdf * 2.0 * std::f64::consts::PI / f64::from(4 * n * n);
                pdf
            });
            assert!(whole < 1.0 + 5e-3, "{params:?} {cos}: {whole}");
            const SAMPLES: u32 = 8192;
            let mut found = [0_u32; 32];
            for k in 0..SAMPLES {
                let u = Sampler::new([k % 64, k / 64], k, 5).set(0);
                if let Some(s) = bsdf.sample(wo, [u[0], u[1], u[2]]) {
                    assert!((s.pdf - bsdf.pdf(wo, s.wi)).abs() <= 1e-3 * s.pdf);
                    assert!((s.value - bsdf.eval(wo, s.wi)).length() <= 1e-3 * s.value.length());
                    found[cell(s.wi)] += 1;
                }
            }
            // Chi-square with 32 cells: above 80 by chance in fewer than one of 10^5 cases.
            let chi: f64 = expected
                .iter()
                .zip(found)
                .filter(|(e, _)| **e * f64::from(SAMPLES) > 5.0)
                .map(|(e, n)| {
                    let e = e * f64::from(SAMPLES);
                    (f64::from(n) - e).powi(2) / e
                })
                .sum();
            assert!(chi < 80.0, "{params:?} {cos}: {chi}");
        }
    }
}

#[test]
fn what_goes_in_one_way_comes_out_the_other() {
    for params in grid() {
        let bsdf = upright(&params);
        for (a, b) in [(0.2, 0.7), (0.9, 0.4), (0.05, 0.5)] {
            let wo = slanted(a);
            let wi = Frame::around(Vec3::Z).world_from_local(Vec3::new(
                -0.6 * slanted(b).x,
                0.8 * slanted(b).x,
                b,
            ));
            let forth = bsdf.eval(wo, wi) / wi.z;
            let back = bsdf.eval(wi, wo) / wo.z;
            assert!(
                (forth - back).length() <= 1e-4 * forth.length().max(1e-3),
                "{params:?}: {forth} {back}"
            );
        }
    }
}

#[test]
fn no_light_leaks_through_the_surface() {
    let normal = Vec3::new(0.6, 0.0, 0.8);
    let bsdf = Bsdf::new(&SurfaceParams::default(), Frame::around(normal), Vec3::Z);
    let wo = Vec3::Z;
    // Above the shading normal's horizon and below the surface; and the other way round.
    for wi in [
        Vec3::new(0.99, 0.0, -0.1).normalize(),
        Vec3::new(-0.99, 0.0, 0.1).normalize(),
    ] {
        assert_eq!(bsdf.eval_all(wo, wi), BsdfValue::default());
        assert_eq!(bsdf.eval_all(wi, wo), BsdfValue::default());
    }
    for k in 0..1000 {
        let u = Sampler::new([0, 0], k, 0).set(0);
        if let Some(s) = bsdf.sample(wo, [u[0], u[1], u[2]]) {
            assert!(s.wi.z > 0.0 && s.wi.dot(normal) > 0.0);
        }
    }
}

#[test]
fn nonsense_is_clamped() {
    let bsdf = upright(&SurfaceParams {
        diffuse_color: Vec3::new(f32::NAN, -1.0, 9.0),
        roughness: f32::NAN,
        metallic: 7.0,
        clearcoat: f32::INFINITY,
        clearcoat_roughness: -3.0,
        ior: f32::NAN,
        ..SurfaceParams::default()
    });
    for k in 0..100 {
        let u = Sampler::new([0, 0], k, 0).set(0);
        if let Some(s) = bsdf.sample(slanted(0.4), [u[0], u[1], u[2]]) {
            assert!(s.value.is_finite() && s.pdf.is_finite());
        }
    }
    // Black reflects nothing, and says so.
    let black = upright(&SurfaceParams::lambert(Vec3::ZERO));
    assert_eq!(black.sample(Vec3::Z, [0.5; 3]), None);
}

#[test]
fn a_normal_bends_just_above_the_horizon() {
    let wo = Vec3::X;
    assert_eq!(bent_towards(Vec3::X, wo), Vec3::X);
    let bent = bent_towards(Vec3::new(-0.6, 0.8, 0.0), wo);
    assert!((bent.dot(wo) - 0.02).abs() < 1e-6 && bent.y > 0.99);
    assert_eq!(bent_towards(-wo, wo), wo);
}
