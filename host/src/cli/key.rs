//! The command `loadtwin key`: makes an Ed25519 key pair that signs model images and the key page
//! of a board, or, with `--public`, the key page of one more board.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::file_plan::{Plan, Replace};
use super::printing::{say, shown};
use crate::key::{KEY, SigningKey, read_public, save_page};

/// Make a key pair that signs model images, and the key page of a board.
#[derive(Debug, Args)]
pub struct Key {
    /// The machine that the board is on: `id` of its description, `name` where it has none.
    /// The board takes images for this machine only.
    #[arg(long, value_name = "ID")]
    machine: String,
    /// Make the key page of one more board, with this public key, in place of a new pair.
    #[arg(long, value_name = "FILE.pub")]
    public: Option<PathBuf>,
    /// The private key, from which the public key and the board's key page get their
    /// names; with `--public` the key page. None may be there yet.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
}

impl Key {
    pub(super) fn run(&self, as_json: bool) -> anyhow::Result<()> {
        if let Some(public) = &self.public {
            Plan::new(Replace::default())
                .reads([public])
                .writes_new("--output", Some(&self.output), KEY)
                .check(as_json)?;
            save_page(read_public(public)?, &self.machine, &self.output)?;
            if as_json {
                say!(
                    "{}",
                    json!({ "page": shown(&self.output), "machine": self.machine })
                );
            } else {
                say!("key page of the board: {}", self.output.display());
            }
            return Ok(());
        }
        let mut plan = Plan::new(Replace::default());
        for path in SigningKey::files(&self.output).all() {
            plan = plan.writes_new("--output", Some(path), KEY);
        }
        plan.check(as_json)?;
        let files = SigningKey::generate()?.save(&self.output, &self.machine)?;
        if as_json {
            say!(
                "{}",
                json!({
                    "private": shown(&files.private),
                    "public": shown(&files.public),
                    "page": shown(&files.page),
                    "machine": self.machine,
                })
            );
        } else {
            say!("private key: {}", files.private.display());
            say!("public key: {}", files.public.display());
            say!("key page of the board: {}", files.page.display());
        }
        Ok(())
    }
}
