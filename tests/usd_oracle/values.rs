//! Values of the properties that OpenUSD resolved.
#![allow(clippy::unwrap_used, missing_docs, reason = "a test")]

use relievo::math::{DAffine3, DMat4};
use relievo::mesh::Crease;
use serde_json::Value;

/// The value of a property at a time; a default for what has no samples.
pub fn property<'a>(prim: &'a Value, name: &str, time: &str) -> Option<&'a Value> {
    let property = prim.get("props")?.get(name)?;
    property.get(time).or_else(|| property.get("d"))
}

pub fn integers(prim: &Value, name: &str, time: &str) -> Vec<u32> {
    let values = property(prim, name, time).and_then(Value::as_array);
    values
        .into_iter()
        .flatten()
        .map(|v| u32::try_from(v.as_i64().unwrap()).unwrap())
        .collect()
}

pub fn word<'a>(prim: &'a Value, name: &str, default: &'a str) -> &'a str {
    property(prim, name, "d")
        .and_then(Value::as_str)
        .unwrap_or(default)
}

pub fn float(prim: &Value, name: &str, time: &str, default: f32) -> f32 {
    property(prim, name, time)
        .and_then(Value::as_f64)
        .map_or(default, |v| v as f32)
}

pub fn matrix(prim: &Value, time: &str) -> DAffine3 {
    let xf = &prim["xf"];
    let numbers = xf.get(time).unwrap_or(&xf["d"]).as_array().unwrap();
    let numbers: Vec<f64> = numbers.iter().map(|v| v.as_f64().unwrap()).collect();
    DAffine3::from_mat4(DMat4::from_cols_slice(&numbers))
}

pub fn near(a: DAffine3, b: DAffine3) -> bool {
    let size = 1.0
        + b.to_cols_array()
            .iter()
            .fold(0.0_f64, |m, v| m.max(v.abs()));
    a.abs_diff_eq(b, 2e-6 * size)
}

pub fn floats(prim: &Value, name: &str, time: &str) -> Vec<f32> {
    let mut out = Vec::new();
    numbers(property(prim, name, time).unwrap_or(&Value::Null), &mut out);
    out
}

/// The numbers of a value, however deep; whether there is nothing else in it.
pub fn numbers(value: &Value, out: &mut Vec<f32>) -> bool {
    match value {
        Value::Number(n) => {
            out.push(n.as_f64().unwrap() as f32);
            true
        }
        Value::Array(values) => values.iter().all(|v| numbers(v, out)),
        _ => false,
    }
}

/// One crease an edge, with the sharpness of its chain or its own.
pub fn creases(prim: &Value, time: &str) -> Vec<Crease> {
    let indices = integers(prim, "creaseIndices", time);
    let lengths = integers(prim, "creaseLengths", time);
    let sharpnesses = floats(prim, "creaseSharpnesses", time);
    let mut out: Vec<Crease> = Vec::new();
    let mut start = 0;
    for (chain, length) in lengths.iter().enumerate() {
        for edge in indices[start..start + *length as usize].windows(2) {
            let of_chain = sharpnesses.len() == lengths.len();
            out.push(Crease {
                vertices: [edge[0], edge[1]],
                sharpness: sharpnesses[if of_chain { chain } else { out.len() }],
            });
        }
        start += *length as usize;
    }
    out
}

pub fn doubles(prim: &Value, name: &str) -> Vec<f64> {
    fn flat(value: &Value, out: &mut Vec<f64>) {
        match value.as_array() {
            Some(all) => all.iter().for_each(|v| flat(v, out)),
            None => out.push(value.as_f64().unwrap()),
        }
    }
    let mut out = Vec::new();
    if let Some(value) = property(prim, name, "d") {
        flat(value, &mut out);
    }
    out
}
