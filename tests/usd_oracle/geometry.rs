//! Meshes, their primvars, and NURBS patches against what OpenUSD resolved.
#![allow(clippy::unwrap_used, missing_docs, reason = "a test")]

use relievo::math::Vec3;
use relievo::mesh::{
    BoundaryInterpolation, ControlMesh, FaceVaryingInterpolation, Interpolation, NurbsPatch,
    Scheme, TriangleRule,
};
use serde_json::Value;

use super::values::{creases, doubles, floats, integers, numbers, property, word};

/// Compares the primvars of floats, flattened and inherited ones included; how many there were.
pub fn compare_primvars(
    place: &str,
    mesh: &ControlMesh,
    inherited_color: Option<Vec3>,
    prim: &Value,
    time: &str,
) -> usize {
    let mut found = 0;
    for (name, theirs) in prim["pv"].as_object().unwrap() {
        let place = format!("{place}: primvar {name}");
        let own = &prim["props"][format!("primvars:{name}")];
        // What was flattened is the default value; texts and whole numbers are no primvars to a renderer.
        let type_name = own["type"].as_str().unwrap_or("float");
        let is_float = [
            "float", "double", "half", "color", "texCoord", "vector", "point", "normal",
        ]
        .iter()
        .any(|start| type_name.starts_with(start));
        if own.get("times").is_some() || !is_float || name == "normals" {
            continue;
        }
        let mut values = Vec::new();
        if !numbers(&theirs["flat"], &mut values) || values.is_empty() {
            continue;
        }
        let interpolation = match theirs["interp"].as_str().unwrap() {
            "constant" => Interpolation::Constant,
            "uniform" => Interpolation::Uniform,
            "varying" => Interpolation::Varying,
            "vertex" => Interpolation::Vertex,
            "faceVarying" => Interpolation::FaceVarying,
            other => panic!("{place}: {other}"),
        };
        let Some(mine) = mesh.primvar(name) else {
            assert_eq!(name, "displayColor", "{place} is missing at {time}");
            let color = inherited_color.map(|c| c.to_array().to_vec());
            assert_eq!(color, Some(values), "{place}");
            continue;
        };
        assert_eq!(mine.interpolation, interpolation, "{place}");
        let count = mine.indices.as_ref().map_or(mine.elements(), Vec::len);
        let flat: Vec<f32> = (0..count).flat_map(|i| mine.get(i).to_vec()).collect();
        assert_eq!(flat, values, "{place}");
        let element = theirs["es"].as_u64().unwrap() as u32;
        assert_eq!(mine.width % element, 0, "{place}");
        found += 1;
    }
    found
}

pub fn compare_mesh(place: &str, mesh: &ControlMesh, prim: &Value, time: &str) {
    assert_eq!(
        mesh.face_vertex_counts,
        integers(prim, "faceVertexCounts", time),
        "{place}"
    );
    assert_eq!(
        mesh.face_vertex_indices,
        integers(prim, "faceVertexIndices", time),
        "{place}"
    );
    assert_eq!(mesh.holes, integers(prim, "holeIndices", time), "{place}");
    let corners: Vec<u32> = mesh.corners.iter().map(|c| c.vertex).collect();
    assert_eq!(corners, integers(prim, "cornerIndices", time), "{place}");
    let sharpnesses: Vec<f32> = mesh.corners.iter().map(|c| c.sharpness).collect();
    assert_eq!(
        sharpnesses,
        floats(prim, "cornerSharpnesses", time),
        "{place}"
    );
    assert_eq!(mesh.creases, creases(prim, time), "{place}");
    let points = property(prim, "points", time)
        .and_then(Value::as_array)
        .unwrap();
    assert_eq!(mesh.points[0].len(), points.len(), "{place}");
    for (mine, theirs) in mesh.points[0].iter().zip(points) {
        let theirs: Vec<f32> = theirs
            .as_array()
            .unwrap()
            .iter()
            .map(|v| v.as_f64().unwrap() as f32)
            .collect();
        assert!(mine.abs_diff_eq(Vec3::from_slice(&theirs), 1e-5), "{place}");
    }
    let scheme = match word(prim, "subdivisionScheme", "catmullClark") {
        "loop" => Scheme::Loop,
        "bilinear" => Scheme::Bilinear,
        "none" => Scheme::None,
        _ => Scheme::CatmullClark,
    };
    let boundary = match word(prim, "interpolateBoundary", "edgeAndCorner") {
        "none" => BoundaryInterpolation::None,
        "edgeOnly" => BoundaryInterpolation::EdgeOnly,
        _ => BoundaryInterpolation::EdgeAndCorner,
    };
    let face_varying = match word(prim, "faceVaryingLinearInterpolation", "cornersPlus1") {
        "none" => FaceVaryingInterpolation::None,
        "cornersOnly" => FaceVaryingInterpolation::CornersOnly,
        "cornersPlus2" => FaceVaryingInterpolation::CornersPlus2,
        "boundaries" => FaceVaryingInterpolation::Boundaries,
        "all" => FaceVaryingInterpolation::All,
        _ => FaceVaryingInterpolation::CornersPlus1,
    };
    let triangles = match word(prim, "triangleSubdivisionRule", "catmullClark") {
        "smooth" => TriangleRule::Smooth,
        _ => TriangleRule::CatmullClark,
    };
    assert_eq!(
        (
            mesh.scheme,
            mesh.boundary,
            mesh.face_varying,
            mesh.triangle_rule
        ),
        (scheme, boundary, face_varying, triangles),
        "{place}"
    );
    assert_eq!(
        mesh.left_handed,
        word(prim, "orientation", "rightHanded") == "leftHanded",
        "{place}"
    );
}

pub fn compare_patch(place: &str, patch: &NurbsPatch, prim: &Value) {
    for (name, direction) in [("u", &patch.u), ("v", &patch.v)] {
        let named = |what: &str| doubles(prim, &format!("{name}{what}"));
        assert_eq!(direction.knots, named("Knots"), "{place}");
        assert_eq!(vec![direction.order as f64], named("Order"), "{place}");
        assert_eq!(
            vec![direction.count as f64],
            named("VertexCount"),
            "{place}"
        );
        assert_eq!(direction.range.unwrap().to_vec(), named("Range"), "{place}");
        let form = format!("{:?}", direction.form).to_lowercase();
        assert_eq!(form, word(prim, &format!("{name}Form"), "open"), "{place}");
    }
    let near = |mine: Vec<f64>, name: &str| {
        let theirs = doubles(prim, name);
        assert_eq!(mine.len(), theirs.len(), "{place} {name}");
        assert!(
            mine.iter().zip(&theirs).all(|(a, b)| (a - b).abs() < 1e-6),
            "{place} {name}"
        );
    };
    near(
        patch.points[0]
            .iter()
            .flat_map(|p| p.to_array().map(f64::from))
            .collect(),
        "points",
    );
    near(patch.weights.clone().unwrap_or_default(), "pointWeights");
    let curves = || patch.trims.iter().flatten();
    near(
        patch.trims.iter().map(|l| l.len() as f64).collect(),
        "trimCurve:counts",
    );
    near(
        curves().map(|c| c.order as f64).collect(),
        "trimCurve:orders",
    );
    near(
        curves().map(|c| c.points.len() as f64).collect(),
        "trimCurve:vertexCounts",
    );
    near(
        curves().flat_map(|c| c.knots.clone()).collect(),
        "trimCurve:knots",
    );
    near(curves().flat_map(|c| c.range).collect(), "trimCurve:ranges");
    near(
        curves()
            .flat_map(|c| c.points.iter().flatten().copied())
            .collect(),
        "trimCurve:points",
    );
}
