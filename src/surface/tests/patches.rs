//! NURBS patches as surfaces: against the sphere that one of them is, their bounds, primvars and trims.

use std::f32::consts::FRAC_1_SQRT_2;

use super::shapes::Random;
use super::*;
use crate::mesh::{Interpolation, NurbsDirection, NurbsPatch, Primvar, TrimCurve};

const KNOTS: [f64; 12] = [0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 4.0];
const S: f32 = FRAC_1_SQRT_2;
const CIRCLE: [([f32; 2], f32); 9] = [
    ([1.0, 0.0], 1.0),
    ([1.0, 1.0], S),
    ([0.0, 1.0], 1.0),
    ([-1.0, 1.0], S),
    ([-1.0, 0.0], 1.0),
    ([-1.0, -1.0], S),
    ([0.0, -1.0], 1.0),
    ([1.0, -1.0], S),
    ([1.0, 0.0], 1.0),
];

fn direction(order: usize, knots: &[f64]) -> NurbsDirection {
    NurbsDirection {
        order,
        count: knots.len() - order,
        knots: knots.to_vec(),
        ..NurbsDirection::default()
    }
}

/// A rational sphere of radius 1 with poles.
pub(super) fn sphere() -> NurbsPatch {
    let profile = [
        ([0.0, -1.0], 1.0),
        ([1.0, -1.0], S),
        ([1.0, 0.0], 1.0),
        ([1.0, 1.0], S),
        ([0.0, 1.0], 1.0),
    ];
    let all = || (profile.iter()).flat_map(|&(p, w)| CIRCLE.map(|(c, wc)| (p, c, w * wc)));
    let point = |([r, z], [x, y], _): ([f32; 2], [f32; 2], f32)| Vec3::new(r * x, r * y, z);
    NurbsPatch {
        u: direction(3, &KNOTS),
        v: direction(3, &[0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 2.0, 2.0]),
        points: vec![all().map(point).collect()],
        weights: Some(all().map(|(.., w)| f64::from(w)).collect()),
        ..NurbsPatch::default()
    }
}

/// A bicubic sheet of two by one pieces over -1..1, without weights, trimmed to a disc of radius 0.8 around (0.1, 0).
pub(super) fn sheet() -> NurbsPatch {
    let knots = [-1.0, -1.0, -1.0, -1.0, 0.25, 1.0, 1.0, 1.0, 1.0];
    let curve = TrimCurve {
        order: 3,
        knots: KNOTS.to_vec(),
        range: [0.0, 4.0],
        points: CIRCLE
            .map(|([x, y], w)| {
                let [x, y, w] = [x, y, w].map(f64::from);
                [w * (0.1 + 0.8 * x), w * 0.8 * y, w]
            })
            .to_vec(),
    };
    let mut random = Random(3);
    let points = (0..20).map(|i| {
        let height = random.uv().x;
        Vec3::new((i % 5) as f32, (i / 5) as f32, height)
    });
    NurbsPatch {
        u: direction(4, &knots),
        v: direction(4, &[-1.0, -1.0, -1.0, -1.0, 1.0, 1.0, 1.0, 1.0]),
        points: vec![points.collect()],
        trims: vec![vec![curve]],
        ..NurbsPatch::default()
    }
}

fn base(patch: &NurbsPatch, names: &[&str], st: Option<&str>) -> Arc<Patch> {
    Arc::new(Patch::new(patch, names, st).expect("a valid patch"))
}

#[test]
fn a_rational_sphere_is_displaced_along_its_normals_and_closed() {
    let ball = base(&sphere(), &["st"], Some("st"));
    assert_eq!(
        (
            ball.faces(),
            ball.is_collapsed(0, 0),
            ball.is_collapsed(0, 2)
        ),
        (8, true, false)
    );
    let up = || Displacement::Scalar(amount(Function::scalar(|_| 0.5), 0.5));
    for (displacement, radius) in [(Displacement::None, 1.0), (up(), 1.25)] {
        let surface = Surface::new(ball.clone(), displacement);
        assert!(surface.is_closed());
        let diced = Diced::new(&surface, &Rates::uniform(&surface, 9));
        for p in diced.positions().iter().flatten() {
            assert!((p.length() - radius).abs() < 1e-5, "{p}");
        }
        // Both faces of each edge have its points; normals look outward up to the poles.
        let shared = SharedSamples::new(&surface, &Rates::uniform(&surface, 4), 0);
        for face in 0..8 {
            for k in 0..4 {
                for p in shared.walk(&surface, face, k) {
                    assert!((p.length() - radius).abs() < 1e-5, "{p}");
                }
            }
            for uv in [Vec2::ZERO, Vec2::new(0.3, 0.6), Vec2::ONE] {
                let p = surface.evaluate(face, uv, 0);
                assert!(
                    p.normal.distance(p.limit.position) < 1e-4,
                    "{face} {uv} {p:?}"
                );
            }
        }
        assert_eq!(surface.faults(), Faults::default());
    }
}

#[test]
fn parts_of_pieces_are_within_their_hulls_and_patches() {
    let mut random = Random(7);
    for (patch, polynomial) in [(sphere(), false), (sheet(), true)] {
        let base = base(&patch, &["st"], Some("st"));
        for i in 0..400 {
            let face = i % base.faces();
            let (a, b) = (random.uv(), random.uv());
            let rect = UvRect {
                min: a.min(b),
                max: a.max(b),
            };
            let uv = random.uv();
            let at = (rect.min + uv * (rect.max - rect.min)).clamp(rect.min, rect.max);
            let p = base.evaluate(face, at, 0).position;
            let hull = base.hull(face, &rect, 0);
            assert_eq!(hull.including(p), hull, "{face} {rect:?} {at}");
            let st = base.texcoord(face, at).expect("coordinates").st;
            let hull = base.texcoord_hull(face, &rect).expect("coordinates");
            assert!(
                hull.min.cmple(st).all() && st.cmple(hull.max).all(),
                "{rect:?} {st}"
            );
            let bicubic = base.bezier(face, &rect, 0);
            assert_eq!(bicubic.is_some(), polynomial);
            if let Some(bicubic) = bicubic {
                assert!((bicubic.evaluate(uv).position - p).length() < 1e-5);
            }
        }
    }
}

#[test]
fn primvars_follow_the_patch() {
    let primvar = |name: &str, interpolation, width, values: &[f32]| Primvar {
        name: name.into(),
        interpolation,
        width,
        values: values.to_vec(),
        indices: None,
    };
    let mut patch = sheet();
    let points = patch.points[0].clone();
    let flat: Vec<f32> = points.iter().flat_map(|p| p.to_array()).collect();
    let four: Vec<f32> = points.iter().flat_map(|p| [p.x, p.y, p.z, p.x]).collect();
    let xy: Vec<f32> = points.iter().flat_map(|p| [p.x, p.y]).collect();
    patch.primvars = vec![
        primvar("whole", Interpolation::Constant, 1, &[7.0]),
        primvar("piece", Interpolation::Uniform, 1, &[1.0, 2.0]),
        primvar(
            "corner",
            Interpolation::Varying,
            1,
            &[0.0, 1.0, 3.0, 0.0, 1.0, 3.0],
        ),
        primvar("P", Interpolation::Vertex, 3, &flat),
        primvar("four", Interpolation::Vertex, 4, &four),
        primvar("st", Interpolation::Vertex, 2, &xy),
    ];
    let base = base(
        &patch,
        &["whole", "piece", "corner", "P", "four", "st"],
        Some("st"),
    );
    let get = |name: &str, face: u32, uv: Vec2, out: &mut [f32]| {
        let slot = base.slot(name, out.len()).expect(name);
        base.primvar(slot, face, uv, out);
    };
    for face in 0..2 {
        for uv in [Vec2::ZERO, Vec2::new(0.25, 0.5), Vec2::ONE] {
            let p = base.evaluate(face, uv, 0);
            let (mut one, mut three, mut four) = ([0.0], [0.0; 3], [0.0; 4]);
            get("whole", face, uv, &mut one);
            assert_eq!(one, [7.0]);
            get("piece", face, uv, &mut one);
            assert_eq!(one, [[1.0], [2.0]][face as usize]);
            get("corner", face, uv, &mut one);
            let corner = [uv.x, 1.0 + 2.0 * uv.x][face as usize];
            assert!((one[0] - corner).abs() < 1e-6);
            get("P", face, uv, &mut three);
            assert!((Vec3::from(three) - p.position).length() < 1e-5);
            get("four", face, uv, &mut four);
            assert!((four[3] - p.position.x).abs() < 1e-5 && (four[1] - three[1]).abs() < 1e-6);
            let st = base.texcoord(face, uv).expect("coordinates");
            assert!((st.st - p.position.truncate()).length() < 1e-5);
            assert!((st.du - p.du.truncate()).length() < 1e-4);
        }
    }
    assert_eq!(base.slot("P", 4), None);
}

#[test]
fn trims_leave_what_they_wind_around() {
    let base = base(&sheet(), &[], None);
    assert!(base.is_trimmed() && !base.is_hole(0) && !base.is_hole(1));
    // The parameters u = -1 + 1.25 x and u = 0.25 + 0.75 x, v = -1 + 2 y.
    assert!(base.is_kept(0, Vec2::new(0.9, 0.5)) && !base.is_kept(0, Vec2::new(0.1, 0.5)));
    assert!(base.is_kept(1, Vec2::new(0.8, 0.5)) && !base.is_kept(1, Vec2::new(0.9, 0.5)));
    assert!(!Surface::new(base, Displacement::None).is_closed());
    let mut away = sheet();
    for point in &mut away.trims[0][0].points {
        point[0] += 9.0 * point[2];
    }
    let gone = Patch::new(&away, &[], None).expect("a valid patch");
    assert!(gone.is_hole(0) && gone.is_hole(1));
}
