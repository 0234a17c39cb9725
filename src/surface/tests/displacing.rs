//! Displaced points and normals.

use super::shapes::Random;
use super::*;
use crate::error::Warnings;

/// The displaced derivatives against differences of displaced points, on surfaces with and without texture
/// coordinates, of either handedness.
#[test]
fn displaced_derivatives_are_those_of_the_points() {
    let mut random = Random(1);
    for left_handed in [false, true] {
        for textured in [false, true] {
            for (name, displacement) in displacements(0.2) {
                let mut base = Patches::torus(5, 4).turned();
                base.left_handed = left_handed;
                if !textured {
                    base.st = None;
                }
                let surface = surface(base, displacement);
                let mut worst = 0.0_f32;
                for i in 0..300 {
                    let face = i % surface.base().faces();
                    let uv = 0.9 * random.uv() + 0.05;
                    let p = surface.evaluate(face, uv, 0);
                    let alone = surface.position(face, uv, 0);
                    assert!((alone - p.position).length() < 1e-6, "{name} {alone} {p:?}");
                    // Over the kinks of the bilinear filter both one-sided differences disagree: skip those points.
                    let h = 1e-3;
                    let side = |axis: Vec2, sign: f32| {
                        let there = surface.evaluate(face, uv + sign * h * axis, 0).position;
                        sign * (there - p.position) / h
                    };
                    for (axis, d) in [(Vec2::X, p.du), (Vec2::Y, p.dv)] {
                        let (before, after) = (side(axis, -1.0), side(axis, 1.0));
                        if (before - after).length() < 0.03 * d.length() + 0.01 {
                            let error = (0.5 * (before + after) - d).length() / (d.length() + 0.3);
                            worst = worst.max(error);
                        }
                    }
                    let front = if left_handed { -1.0 } else { 1.0 };
                    let normal = front * p.du.cross(p.dv).normalize();
                    assert!((normal - p.normal).length() < 1e-4, "{name} {p:?}");
                }
                assert!(worst < 0.02, "{name}, left-handed {left_handed}: {worst}");
            }
        }
    }
}

#[test]
fn scalar_displacement_is_along_the_normal_to_the_front() {
    let constant = || Displacement::Scalar(amount(Function::scalar(|_| 0.5), 0.5));
    for left_handed in [false, true] {
        let mut base = Patches::sphere(4);
        base.left_handed = left_handed;
        let surface = surface(base, constant());
        let expected = if left_handed { 0.75 } else { 1.25 };
        let p = surface.evaluate(3, Vec2::new(0.3, 0.6), 0);
        assert!((p.position.length() - expected).abs() < 1e-3, "{p:?}");
    }
    // Scale and bias: 0.5 * 2 - 1 = 0.
    let still = Displacement::Scalar(Amount {
        bias: -1.0,
        ..amount(Function::scalar(|_| 0.5), 2.0)
    });
    let p = surface(Patches::cube(), still).evaluate(0, Vec2::splat(0.5), 0);
    assert_eq!(p.position, p.limit.position);
}

/// In tangent space x follows s, y follows t, whichever way the mapping is turned or mirrored.
#[test]
fn tangent_space_follows_the_texture() {
    let mut base = Patches::cube();
    let mirrored = [Vec2::X, Vec2::ZERO, Vec2::Y, Vec2::ONE];
    base.st.as_mut().expect("it has")[1] = mirrored;
    for (face, base) in [(0, base.clone()), (1, base)] {
        for d in [Vec3::X, Vec3::Y, Vec3::Z] {
            let displacement =
                Displacement::Vector(amount(Function::vector(move |_| d), 1.0), Space::Tangent);
            let surface = surface(base.clone(), displacement);
            let uv = Vec2::new(0.25, 0.5);
            let p = surface.evaluate(face, uv, 0);
            let moved = p.position - p.limit.position;
            // Where the texture coordinates go along the surface, by a small step in uv.
            let st = |uv| surface.base().texcoord(face, uv).expect("it has").st;
            let gradient = |axis: Vec2| {
                let along = |uv_axis: Vec2, d: Vec3| {
                    let rate = (st(uv + 0.1 * uv_axis) - st(uv)).dot(axis) / 0.1;
                    rate * d / d.length_squared()
                };
                along(Vec2::X, p.limit.du) + along(Vec2::Y, p.limit.dv)
            };
            let expected = if d == Vec3::Z {
                p.limit.du.cross(p.limit.dv)
            } else {
                gradient(d.truncate())
            };
            assert!(
                (moved - expected.normalize()).length() < 1e-5,
                "face {face}, {d}: {moved} {expected}"
            );
        }
    }
}

#[test]
fn poles_have_normals() {
    let constant = Displacement::Scalar(amount(Function::scalar(|_| 1.0), 0.1));
    let surface = surface(Patches::globe(6), constant);
    for (face, v, z) in [(0, 0.0, -1.0), (1, 1.0, 1.0)] {
        for u in [0.0, 0.3, 1.0] {
            let p = surface.evaluate(face, Vec2::new(u, v), 0);
            assert!((p.position - 1.1 * z * Vec3::Z).length() < 0.02, "{p:?}");
            assert_eq!(surface.position(face, Vec2::new(u, v), 0), p.position);
        }
    }
    assert_eq!(surface.faults(), Faults::default());
}

#[test]
fn what_cannot_be_displaced_stays_and_is_told_once() {
    for bad in [f32::NAN, f32::INFINITY, f32::MAX] {
        let displacement = Displacement::Scalar(amount(
            Function::scalar(move |at| if at.uv.x > 0.5 { bad } else { 0.1 }),
            4.0,
        ));
        let surface = surface(Patches::cube(), displacement);
        let diced = Diced::new(&surface, &Rates::uniform(&surface, 8));
        assert!(diced.positions()[0].iter().all(|p| p.is_finite()));
        let p = surface.evaluate(0, Vec2::new(0.75, 0.5), 0);
        assert_eq!(p.position, p.limit.position);
        assert!(surface.faults().non_finite > 100);
        let mut warnings = Warnings::default();
        surface.report("/Cube", &mut warnings);
        assert_eq!(warnings.iter().count(), 1);
    }
    // A face that is but a point.
    let point = Patches::bilinear(&[Vec3::ONE; 4], vec![[0, 1, 2, 3]]);
    let surface = surface(
        point,
        Displacement::Scalar(amount(Function::scalar(|_| 1.0), 1.0)),
    );
    let diced = Diced::new(&surface, &Rates::uniform(&surface, 2));
    assert_eq!(diced.positions()[0], vec![Vec3::ONE; 9]);
    assert_eq!(surface.faults().degenerate, 9);
}

/// On a flat surface the bump's normal is that of the displaced surface, and it never leaves the front.
#[test]
fn a_bump_map_tilts_the_normal_alone() {
    let heights = amount(
        ImageMap::new(noise([8, 8], "Y", Wrap::Clamp, 3), Channels::Scalar),
        0.05,
    );
    let flat = surface(Patches::cube(), Displacement::None);
    let displaced = surface(Patches::cube(), Displacement::Scalar(heights.clone()));
    let mut random = Random(2);
    for face in 0..6 {
        for _ in 0..50 {
            let uv = random.uv();
            let p = flat.evaluate(face, uv, 0);
            let bumped = flat.bumped_normal(&p, &heights, (face, uv, 0));
            let expected = displaced.evaluate(face, uv, 0).normal;
            assert!((bumped - expected).length() < 1e-5 && bumped.dot(p.normal) > 0.0);
        }
    }
}

#[test]
fn look_ups_and_slopes_follow_the_filter() {
    let mut random = Random(4);
    for wrap in [Wrap::Black, Wrap::Clamp, Wrap::Repeat, Wrap::Mirror] {
        let texture = noise([13, 7], "RGB", wrap, 9);
        let mut kinks = 0;
        for _ in 0..2000 {
            let st = 4.0 * random.uv() - 1.5;
            let (mut one, mut three) = (Vec::new(), Vec::new());
            texture.look_up(&[st], &mut one, |[x]| x);
            texture.look_up(&[st], &mut three, |xyz: [f32; 3]| Vec3::from(xyz));
            let value = texture.eval(st).truncate();
            assert_eq!((one[0], three[0]), (value.x, value));
            let slope = texture.slope(st);
            let h = 1e-3;
            for (axis, slope) in [Vec2::X, Vec2::Y].into_iter().zip(slope) {
                let side = |h: f32| (texture.eval(st + h * axis) - texture.eval(st)) / h;
                if (side(h) - slope).length() > 0.05 && (side(-h) - slope).length() > 0.05 {
                    kinks += 1;
                }
            }
        }
        // None but where a kink and rounding meet.
        assert!(kinks <= 2, "{wrap:?}: {kinks}");
    }
}
