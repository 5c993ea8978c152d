//! Links of Markdown pages to files and headings of the project.

use std::path::PathBuf;

use crate::markdown_page::Page;

/// Destinations of links in the prose, with their lines.
fn destinations(page: &Page) -> Vec<(usize, String)> {
    let mut found = Vec::new();
    for (number, line) in page.prose() {
        for part in line.split("](").skip(1) {
            let end = part.find(')').unwrap_or(part.len());
            found.push((number, part[..end].to_owned()));
        }
        for attribute in ["src=\"", "srcset=\"", "href=\""] {
            for part in line.split(attribute).skip(1) {
                found.push((number, part.split('"').next().unwrap_or("").to_owned()));
            }
        }
    }
    found.retain(|(_, link)| !link.contains("://") && !link.starts_with("mailto:"));
    found
}

fn resolved(page: &Page, link: &str) -> PathBuf {
    let file = link.split('#').next().unwrap_or("");
    if file.is_empty() {
        return page.path.clone();
    }
    let path = page.path.parent().unwrap().join(file);
    path.canonicalize().unwrap_or(path)
}

/// Files that the page links.
pub fn targets(page: &Page) -> Vec<PathBuf> {
    let links = destinations(page);
    links.iter().map(|(_, link)| resolved(page, link)).collect()
}

/// Links to files or headings that are not there.
pub fn broken(page: &Page) -> Vec<String> {
    let mut found = Vec::new();
    for (line, link) in destinations(page) {
        let path = resolved(page, &link);
        let heading = link.split_once('#').map(|(_, heading)| heading);
        let exists = path.exists()
            && heading.is_none_or(|heading| anchors(&Page::read(&path)).contains(&heading.into()));
        if !exists {
            found.push(format!(
                "{}:{line}: {link} leads nowhere",
                page.path.display()
            ));
        }
    }
    found
}

/// Anchors of the headings: lower case, spaces as hyphens, other punctuation removed.
fn anchors(page: &Page) -> Vec<String> {
    let headings = page.prose().filter(|(_, line)| line.starts_with('#'));
    let anchor = |title: &str| {
        let kept = title.to_lowercase().replace(' ', "-");
        kept.chars()
            .filter(|c| c.is_alphanumeric() || matches!(c, '-' | '_'))
            .collect()
    };
    headings
        .map(|(_, line)| anchor(line.trim_start_matches('#').trim()))
        .collect()
}
