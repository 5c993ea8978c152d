//! The commands `loadtwin completions`, which prints a completion script for a shell, and
//! `loadtwin man`, which writes a man page for each command to a folder.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::{Args, Command, CommandFactory};

use super::file_plan::{Plan, Replace};
use super::printing::print;
use super::{Cli, examples};
use crate::atomic_file::{AtomicFile, publish};
use crate::files::file_kind::FileKind;

/// What is written as a man page.
const MAN_PAGE: FileKind = FileKind {
    noun: "man page",
    suffixes: &["1"],
    is_same: |file| file.contains(&["\n.TH loadtwin"]),
};

/// Print completions for a shell.
#[derive(Debug, Args)]
pub struct Completions {
    /// The shell.
    shell: clap_complete::Shell,
}

impl Completions {
    pub(super) fn run(&self) {
        let mut text = Vec::new();
        clap_complete::generate(self.shell, &mut Cli::command(), "loadtwin", &mut text);
        print(format_args!("{}", String::from_utf8_lossy(&text)));
    }
}

/// Write a man page for each command.
#[derive(Debug, Args)]
pub struct Man {
    /// Folder for the pages.
    folder: PathBuf,
    #[command(flatten)]
    replace: Replace,
}

impl Man {
    pub(super) fn run(&self) -> anyhow::Result<()> {
        let folder = self.folder.display();
        std::fs::create_dir_all(&self.folder).with_context(|| format!("{folder}"))?;
        let mut command = Cli::command().disable_help_subcommand(true);
        command.build();
        let visible = |c: &&Command| !c.is_hide_set();
        let commands = command.get_subcommands().filter(visible).chain([&command]);
        let pages: Vec<(PathBuf, clap_mangen::Man)> = commands
            .map(|command| {
                let page = clap_mangen::Man::new(command.clone());
                (self.folder.join(page.get_filename()), page)
            })
            .collect();
        let plan = Plan::new(self.replace);
        (pages.iter())
            .fold(plan, |plan, (path, _)| {
                plan.writes_beside("FOLDER:", path, MAN_PAGE)
            })
            .check(false)?;
        let mut files = Vec::new();
        for (path, page) in &pages {
            let mut file = AtomicFile::create(path)?;
            page.render(&mut file)?;
            file.write_all(examples_and_status(path).as_bytes())?;
            files.push(file.complete()?);
        }
        Ok(publish(files)?)
    }
}

/// Sections of the page in `path`, `loadtwin-NAME.1`.
fn examples_and_status(path: &Path) -> String {
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let name = name.strip_prefix("loadtwin-").unwrap_or("loadtwin");
    let escaped = |text: &str| text.replace('-', "\\-");
    let lines: Vec<String> = examples::of(name).collect();
    let mut roff = String::new();
    if !lines.is_empty() {
        let lines = escaped(&lines.join("\n"));
        roff += &format!(".SH EXAMPLES\n.nf\n{lines}\n.fi\n");
    }
    roff += ".SH \"EXIT STATUS\"\n";
    for (code, meaning) in examples::EXIT_STATUS {
        roff += &format!(".TP\n{code}\n{}\n", escaped(meaning));
    }
    roff
}
