//! Primvars: on meshes, and inherited constants.

use std::rc::Rc;

use openusd::tf::Token;
use openusd::usd::Prim;

use super::value;
use super::walk::{Inherited, Reader};
use crate::error::Fault;
use crate::math::Vec3;
use crate::mesh::{Interpolation, Primvar};

impl Reader {
    /// The primvars of a mesh's own, by the attributes' names; those that are none with the reason.
    pub(super) fn primvars(
        &mut self,
        prim: &Prim,
        names: &[Token],
    ) -> Vec<(String, Result<Primvar, Fault>)> {
        let mut out = Vec::new();
        for attribute in names {
            let Some(name) = attribute.strip_prefix("primvars:") else {
                continue;
            };
            if name.ends_with(":indices") || name == "normals" {
                continue;
            }
            let primvar = self.primvar(prim, attribute, name, Interpolation::Constant);
            out.extend(primvar.transpose().map(|p| (name.to_owned(), p)));
        }
        out
    }

    /// Tells of a primvar that is left out.
    pub(super) fn warn_unusable(&mut self, prim: &Prim, fault: &Fault) {
        self.warn("unusable primvar", || {
            format!("{}: {fault}; it is left out", prim.path().as_str())
        });
    }

    /// One primvar; `None` if it is not of floats or has no value.
    pub(super) fn primvar(
        &mut self,
        prim: &Prim,
        attribute: &str,
        name: &str,
        default: Interpolation,
    ) -> Result<Option<Primvar>, Fault> {
        let Some(value) = self.value(prim, attribute) else {
            return Ok(None);
        };
        let is_array = value::is_array(&value);
        let Some(floats) = value::floats(value) else {
            return Ok(None);
        };
        if floats.values.is_empty() {
            self.warn("empty primvar", || {
                format!(
                    "{}: primvar {name} is empty; it is left out",
                    prim.path().as_str()
                )
            });
            return Ok(None);
        }
        let word = self
            .metadata(prim, attribute, "interpolation")
            .and_then(value::word);
        let interpolation = match word.as_deref() {
            Some("constant") => Interpolation::Constant,
            Some("uniform") => Interpolation::Uniform,
            Some("varying") => Interpolation::Varying,
            Some("vertex") => Interpolation::Vertex,
            Some("faceVarying") => Interpolation::FaceVarying,
            Some(other) => {
                self.warn("unknown interpolation", || {
                    format!(
                        "{}: primvar {name} has interpolation {other}; it is left out",
                        prim.path().as_str()
                    )
                });
                return Ok(None);
            }
            None => default,
        };
        let size = self
            .metadata(prim, attribute, "elementSize")
            .and_then(|v| value::number(&v))
            .filter(|v| *v >= 1.0 && *v <= 65536.0)
            .map_or(1, |v| v as u32);
        let indices = if is_array && attribute.starts_with("primvars:") {
            let indices = self
                .value(prim, &format!("{attribute}:indices"))
                .and_then(value::integers);
            match indices {
                None => None,
                Some(indices) => Some(to_u32(indices, || format!("primvar {name} has index"))?),
            }
        } else {
            None
        };
        Ok(Some(Primvar {
            name: name.to_owned(),
            interpolation,
            width: floats.width * size,
            values: floats.values,
            indices,
        }))
    }

    /// Takes over a prim's constant primvars for what is below it.
    pub(super) fn inherit_primvars(&mut self, prim: &Prim, names: &[Token], out: &mut Inherited) {
        for attribute in names {
            let Some(name) = attribute.strip_prefix("primvars:") else {
                continue;
            };
            if name.ends_with(":indices") || name == "normals" {
                continue;
            }
            let primvar = match self.primvar(prim, attribute, name, Interpolation::Constant) {
                Ok(Some(primvar)) => primvar,
                Ok(None) => continue,
                Err(fault) => {
                    self.warn_unusable(prim, &fault);
                    continue;
                }
            };
            if primvar.interpolation != Interpolation::Constant {
                continue;
            }
            if name == "displayColor" {
                out.display_color = first_color(&primvar);
                continue;
            }
            let list = Rc::make_mut(&mut out.primvars);
            list.retain(|p| p.name != name);
            list.push(primvar);
        }
    }
}

/// The first element, if it is a colour.
pub(super) fn first_color(primvar: &Primvar) -> Option<Vec3> {
    let element = primvar
        .indices
        .as_ref()
        .and_then(|i| i.first().copied())
        .unwrap_or(0) as usize;
    let rgb = primvar.values.get(element * 3..)?.first_chunk::<3>()?;
    (primvar.width == 3)
        .then(|| Vec3::from(*rgb))
        .filter(|c| c.is_finite())
}

/// Whole numbers that cannot be negative.
pub(super) fn to_u32(values: Vec<i64>, what: impl Fn() -> String) -> Result<Vec<u32>, Fault> {
    values
        .into_iter()
        .map(|v| {
            u32::try_from(v).map_err(|_| {
                Fault::new(format!("{} {v}", what())).advise("indices and counts start from 0")
            })
        })
        .collect()
}
