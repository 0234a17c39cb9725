//! The crate's values as plain numbers, words and paths.

use openusd::sdf::{AssetPath, Value};

use crate::math::{Vec2, Vec3, Vec4};

/// A number of any kind.
pub(super) fn number(value: &Value) -> Option<f64> {
    Some(match value {
        Value::Float(v) => f64::from(*v),
        Value::Double(v) => *v,
        Value::Half(v) => f64::from(f32::from(*v)),
        Value::Int(v) => f64::from(*v),
        Value::Uint(v) => f64::from(*v),
        Value::Int64(v) => *v as f64,
        Value::Uint64(v) => *v as f64,
        Value::TimeCode(v) => v.value(),
        _ => return None,
    })
}

/// A truth; numbers are true unless 0.
pub(super) fn truth(value: &Value) -> Option<bool> {
    match value {
        Value::Bool(v) => Some(*v),
        other => number(other).map(|v| v != 0.0),
    }
}

/// A token or string.
pub(super) fn word(value: Value) -> Option<String> {
    match value {
        Value::Token(v) => Some(v.as_str().to_owned()),
        Value::String(v) => Some(v),
        _ => None,
    }
}

/// An array of tokens or strings.
pub(super) fn words(value: Value) -> Option<Vec<String>> {
    match value {
        Value::TokenVec(v) => Some(v.iter().map(|t| t.as_str().to_owned()).collect()),
        Value::StringVec(v) => Some(v),
        other => word(other).map(|w| vec![w]),
    }
}

/// A path to an asset.
pub(super) fn asset(value: Value) -> Option<AssetPath> {
    match value {
        Value::AssetPath(v) => Some(v),
        Value::String(v) => Some(AssetPath::new(v)),
        _ => None,
    }
}

/// An array of whole numbers.
pub(super) fn integers(value: Value) -> Option<Vec<i64>> {
    Some(match value {
        Value::IntVec(v) => v.into_iter().map(i64::from).collect(),
        Value::UintVec(v) => v.into_iter().map(i64::from).collect(),
        Value::UcharVec(v) => v.into_iter().map(i64::from).collect(),
        Value::Int64Vec(v) => v,
        Value::Uint64Vec(v) => v
            .into_iter()
            .map(|v| i64::try_from(v).unwrap_or(i64::MAX))
            .collect(),
        Value::Int(v) => vec![i64::from(v)],
        _ => return None,
    })
}

/// Numbers with a point, in elements of `width`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Floats {
    /// Components of an element.
    pub(super) width: u32,
    /// All of them.
    pub(super) values: Vec<f32>,
}

/// Floats, doubles and halves, alone, as vectors and as arrays of either; `None` for anything else.
pub(super) fn floats(value: Value) -> Option<Floats> {
    macro_rules! vectors {
        ($v:expr, $width:literal, $convert:expr, $($field:ident),+) => {
            Floats {
                width: $width,
                values: $v.into_iter().flat_map(|e| [$($convert(e.$field)),+]).collect(),
            }
        };
    }
    macro_rules! scalars {
        ($v:expr, $convert:expr) => {
            Floats {
                width: 1,
                values: $v.into_iter().map($convert).collect(),
            }
        };
    }
    let id = |v: f32| v;
    let double = |v: f64| v as f32;
    let half = |v: openusd::gf::f16| f32::from(v);
    Some(match value {
        Value::Float(v) => scalars!([v], id),
        Value::Double(v) => scalars!([v], double),
        Value::Half(v) => scalars!([v], half),
        Value::FloatVec(values) => Floats { width: 1, values },
        Value::DoubleVec(v) => scalars!(v, double),
        Value::HalfVec(v) => scalars!(v, half),
        Value::Vec2f(v) => vectors!([v], 2, id, x, y),
        Value::Vec2d(v) => vectors!([v], 2, double, x, y),
        Value::Vec2h(v) => vectors!([v], 2, half, x, y),
        Value::Vec3f(v) => vectors!([v], 3, id, x, y, z),
        Value::Vec3d(v) => vectors!([v], 3, double, x, y, z),
        Value::Vec3h(v) => vectors!([v], 3, half, x, y, z),
        Value::Vec4f(v) => vectors!([v], 4, id, x, y, z, w),
        Value::Vec4d(v) => vectors!([v], 4, double, x, y, z, w),
        Value::Vec4h(v) => vectors!([v], 4, half, x, y, z, w),
        Value::Vec2fVec(v) => vectors!(v, 2, id, x, y),
        Value::Vec2dVec(v) => vectors!(v, 2, double, x, y),
        Value::Vec2hVec(v) => vectors!(v, 2, half, x, y),
        Value::Vec3fVec(v) => vectors!(v, 3, id, x, y, z),
        Value::Vec3dVec(v) => vectors!(v, 3, double, x, y, z),
        Value::Vec3hVec(v) => vectors!(v, 3, half, x, y, z),
        Value::Vec4fVec(v) => vectors!(v, 4, id, x, y, z, w),
        Value::Vec4dVec(v) => vectors!(v, 4, double, x, y, z, w),
        Value::Vec4hVec(v) => vectors!(v, 4, half, x, y, z, w),
        _ => return None,
    })
}

/// Whether a value is an array.
pub(super) fn is_array(value: &Value) -> bool {
    matches!(
        value,
        Value::FloatVec(_)
            | Value::DoubleVec(_)
            | Value::HalfVec(_)
            | Value::Vec2fVec(_)
            | Value::Vec2dVec(_)
            | Value::Vec2hVec(_)
            | Value::Vec3fVec(_)
            | Value::Vec3dVec(_)
            | Value::Vec3hVec(_)
            | Value::Vec4fVec(_)
            | Value::Vec4dVec(_)
            | Value::Vec4hVec(_)
    )
}

/// An array of points or vectors.
pub(super) fn vectors(value: Value) -> Option<Vec<Vec3>> {
    let floats = floats(value).filter(|f| f.width == 3)?;
    Some(
        floats
            .values
            .chunks_exact(3)
            .map(Vec3::from_slice)
            .collect(),
    )
}

/// Two numbers.
pub(super) fn vec2(value: Value) -> Option<Vec2> {
    let floats = floats(value).filter(|f| f.width == 2)?;
    floats.values.first_chunk::<2>().map(|v| Vec2::from(*v))
}

/// Three numbers.
pub(super) fn vec3(value: Value) -> Option<Vec3> {
    let floats = floats(value).filter(|f| f.width == 3)?;
    floats.values.first_chunk::<3>().map(|v| Vec3::from(*v))
}

/// Four numbers.
pub(super) fn vec4(value: Value) -> Option<Vec4> {
    let floats = floats(value).filter(|f| f.width == 4)?;
    floats.values.first_chunk::<4>().map(|v| Vec4::from(*v))
}

/// An array of rotations: real part last, as glam has it.
pub(super) fn rotations(value: Value) -> Option<Vec<[f64; 4]>> {
    Some(match value {
        Value::QuathVec(v) => v
            .into_iter()
            .map(|q| [q.x, q.y, q.z, q.w].map(|c| f64::from(f32::from(c))))
            .collect(),
        Value::QuatfVec(v) => v
            .into_iter()
            .map(|q| [q.x, q.y, q.z, q.w].map(f64::from))
            .collect(),
        Value::QuatdVec(v) => v.into_iter().map(|q| [q.x, q.y, q.z, q.w]).collect(),
        _ => return None,
    })
}
