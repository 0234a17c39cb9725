//! How layers are opened: as the crate does it, but not before their nesting is looked at.
//!
//! The crate reads text by recursion: a small file of nothing but braces would take all of the stack or of the
//! memory, and a reference to it is enough. Every layer and every entry of a package comes through here.

use std::borrow::Cow;
use std::io::{Error, Read, Result, Seek, SeekFrom};
use std::time::SystemTime;

use openusd::ar::{Asset, AssetInfo, DefaultResolver, ResolvedPath, Resolver};

/// Braces of a text layer may nest this deep.
const MAX_NESTING: usize = 1000;

/// The crate's own resolver behind a check.
pub(super) struct Guarded(DefaultResolver);

impl Guarded {
    pub(super) fn new() -> Self {
        Self(DefaultResolver::new())
    }
}

impl Resolver for Guarded {
    fn create_identifier(&self, asset_path: &str, anchor: Option<&ResolvedPath>) -> String {
        self.0.create_identifier(asset_path, anchor)
    }

    fn resolve(&self, asset_path: &str) -> Option<ResolvedPath> {
        self.0.resolve(asset_path)
    }

    fn resolve_for_new_asset(&self, asset_path: &str) -> Option<ResolvedPath> {
        self.0.resolve_for_new_asset(asset_path)
    }

    fn open_asset(&self, resolved_path: &ResolvedPath) -> Result<Box<dyn Asset>> {
        let mut asset = self.0.open_asset(resolved_path)?;
        check_nesting(&mut asset)?;
        asset.seek(SeekFrom::Start(0))?;
        Ok(asset)
    }

    fn get_extension<'a>(&self, asset_path: &'a str) -> &'a str {
        self.0.get_extension(asset_path)
    }

    fn is_context_dependent_path(&self, asset_path: &str) -> bool {
        self.0.is_context_dependent_path(asset_path)
    }

    fn in_memory_identifier<'a>(&self, asset_path: &'a str) -> Cow<'a, str> {
        self.0.in_memory_identifier(asset_path)
    }

    fn get_asset_info(&self, asset_path: &str, resolved_path: &ResolvedPath) -> AssetInfo {
        self.0.get_asset_info(asset_path, resolved_path)
    }

    fn get_modification_timestamp(
        &self,
        asset_path: &str,
        resolved_path: &ResolvedPath,
    ) -> Option<SystemTime> {
        self.0.get_modification_timestamp(asset_path, resolved_path)
    }

    fn identity(&self) -> String {
        self.0.identity()
    }

    fn cache_id(&self) -> Option<u64> {
        self.0.cache_id()
    }
}

/// Whether the braces of a text layer nest no deeper than the crate stands. Those in strings count too: no honest
/// file has a thousand of them open.
fn check_nesting(asset: &mut impl Read) -> Result<()> {
    let mut start = [0; 5];
    let mut length = 0;
    while length < start.len() {
        match asset.read(&mut start[length..])? {
            0 => return Ok(()),
            n => length += n,
        }
    }
    if &start != b"#usda" {
        return Ok(());
    }
    let mut depth = 0_usize;
    let mut buffer = vec![0; 1 << 16];
    loop {
        let n = asset.read(&mut buffer)?;
        if n == 0 {
            return Ok(());
        }
        for byte in &buffer[..n] {
            match byte {
                b'{' => depth += 1,
                b'}' => depth = depth.saturating_sub(1),
                _ => {}
            }
            if depth > MAX_NESTING {
                return Err(Error::other(format!(
                    "braces nest more than {MAX_NESTING} deep: flatten the hierarchy"
                )));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_text_that_nests_too_deep_is_refused() {
        let nested =
            |start: &str, depth: usize| start.to_owned() + &"{".repeat(depth) + &"}".repeat(depth);
        for (text, fine) in [
            (nested("#usda 1.0\n", MAX_NESTING), true),
            (nested("#usda 1.0\n", MAX_NESTING + 1), false),
            (nested("PXR-USDC", MAX_NESTING + 1), true),
            ("#us".to_owned(), true),
            (
                "#usda 1.0\n".to_owned() + &"{}".repeat(5 * MAX_NESTING),
                true,
            ),
        ] {
            assert_eq!(
                check_nesting(&mut text.as_bytes()).is_ok(),
                fine,
                "{:.20}",
                text
            );
        }
    }
}
