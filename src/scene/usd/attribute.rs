//! Attributes, metadata and relationships of a prim at the frame.

use openusd::sdf::{self, Value};
use openusd::tf::Token;
use openusd::usd::{Prim, TimeCode};

use super::value;
use super::walk::Reader;

impl Reader {
    /// Names of what layers say of a prim.
    pub(super) fn authored(&self, prim: &Prim) -> Vec<Token> {
        prim.authored_property_names().unwrap_or_default()
    }

    pub(super) fn type_name(&self, prim: &Prim) -> String {
        prim.type_name()
            .ok()
            .flatten()
            .map(|t| t.as_str().to_owned())
            .unwrap_or_default()
    }

    pub(super) fn value(&self, prim: &Prim, name: &str) -> Option<Value> {
        self.value_at(prim, name, self.time)
    }

    pub(super) fn value_at(&self, prim: &Prim, name: &str, time: f64) -> Option<Value> {
        match prim.attribute(name).get_at::<Value>(TimeCode::new(time)) {
            Ok(value) => value,
            Err(e) => {
                self.unreadable
                    .borrow_mut()
                    .add("unreadable attribute", || {
                        format!("{}.{name}: {e}", prim.path().as_str())
                    });
                None
            }
        }
    }

    pub(super) fn number(&self, prim: &Prim, name: &str) -> Option<f64> {
        self.value(prim, name).as_ref().and_then(value::number)
    }

    pub(super) fn truth(&self, prim: &Prim, name: &str) -> Option<bool> {
        self.value(prim, name).as_ref().and_then(value::truth)
    }

    pub(super) fn word(&self, prim: &Prim, name: &str) -> Option<String> {
        self.value(prim, name).and_then(value::word)
    }

    pub(super) fn metadata(&self, prim: &Prim, attribute: &str, key: &str) -> Option<Value> {
        prim.attribute(attribute)
            .get_metadata::<Value>(key)
            .ok()
            .flatten()
    }

    pub(super) fn targets(&self, prim: &Prim, name: &str) -> Vec<sdf::Path> {
        prim.relationship(name)
            .forwarded_targets()
            .unwrap_or_default()
    }

    /// Whether an attribute is animated by a spline, which the crate does not evaluate.
    pub(super) fn is_spline(&self, prim: &Prim, name: &str) -> bool {
        prim.attribute(name)
            .has_authored_metadata("spline")
            .unwrap_or(false)
    }
}
