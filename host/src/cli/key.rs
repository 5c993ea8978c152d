//! `loadtwin key`.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::output::say;
use crate::key::SigningKey;

/// Make a key pair that signs model images.
#[derive(Debug, Args)]
pub struct Key {
    /// The private key; the public one and the board's key page get their
    /// names from it. None may be there yet.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
}

impl Key {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        let files = SigningKey::generate()?.save(&self.output)?;
        if as_json {
            say!(
                "{}",
                json!({ "private": files.private, "public": files.public, "page": files.page })
            );
        } else {
            say!("private key: {}", files.private.display());
            say!("public key: {}", files.public.display());
            say!("key page of the board: {}", files.page.display());
        }
        Ok(())
    }
}
