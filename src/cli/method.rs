//! Ways of tracing by their names.

use clap::ValueEnum;
use clap::builder::PossibleValue;
use relievo::world::Method;

/// A method by its name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct MethodArgument(pub(super) Method);

impl ValueEnum for MethodArgument {
    fn value_variants<'a>() -> &'a [Self] {
        const ALL: [MethodArgument; Method::ALL.len()] = {
            let mut all = [MethodArgument(Method::EmbreeTriangles); Method::ALL.len()];
            let mut i = 0;
            while i < Method::ALL.len() {
                all[i] = MethodArgument(Method::ALL[i]);
                i += 1;
            }
            all
        };
        &ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.0.name()).help(self.0.about()))
    }
}
