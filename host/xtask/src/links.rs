//! Links between the pages of the repository: each must lead to a file, and its anchor to a heading.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

/// Folders without pages of this repository; hidden ones have none either.
const SKIPPED: [&str; 2] = ["target", "venv"];

/// Pages by their path from the root.
type Pages = BTreeMap<PathBuf, String>;

/// Checks the relative links of every page; says how many there are.
///
/// # Errors
/// Each link without a target: page, line and link.
pub fn check(root: &Path) -> Result<String, String> {
    let mut pages = Pages::new();
    gather(root, Path::new(""), &mut pages).map_err(|error| format!("pages: {error}"))?;
    let mut count = 0;
    let mut broken = Vec::new();
    for (page, text) in &pages {
        for (line, link) in links(text) {
            count += 1;
            if let Err(why) = resolve(root, &pages, page, link) {
                broken.push(format!("{}:{line}: {link}: {why}", page.display()));
            }
        }
    }
    if broken.is_empty() {
        Ok(format!("{count} links of {} pages lead to a file or a heading", pages.len()))
    } else {
        Err(broken.join("\n"))
    }
}

fn gather(root: &Path, folder: &Path, pages: &mut Pages) -> std::io::Result<()> {
    for entry in std::fs::read_dir(root.join(folder))? {
        let entry = entry?;
        let name = entry.file_name().to_string_lossy().into_owned();
        let path = folder.join(&name);
        if entry.file_type()?.is_dir() {
            if !name.starts_with('.') && !SKIPPED.contains(&name.as_str()) {
                gather(root, &path, pages)?;
            }
        } else if name.ends_with(".md") {
            pages.insert(path, std::fs::read_to_string(entry.path())?);
        }
    }
    Ok(())
}

/// Whether the target of a link exists.
fn resolve(root: &Path, pages: &Pages, page: &Path, link: &str) -> Result<(), String> {
    let (file, anchor) = link.split_once('#').map_or((link, None), |(file, anchor)| (file, Some(anchor)));
    let target = if file.is_empty() { page.to_owned() } else { joined(page, file) };
    match (pages.get(&target), anchor) {
        (Some(text), Some(anchor)) if !anchors(text).contains(anchor) => {
            Err(format!("{} has no heading for #{anchor}", target.display()))
        }
        (None, _) if !root.join(&target).exists() => Err(format!("there is no {}", target.display())),
        _ => Ok(()),
    }
}

/// A path from the root, for a link in a page.
fn joined(page: &Path, file: &str) -> PathBuf {
    let mut path = page.parent().unwrap_or(Path::new("")).to_owned();
    for part in Path::new(file).components() {
        match part {
            Component::ParentDir => drop(path.pop()),
            Component::CurDir => {}
            other => path.push(other),
        }
    }
    path
}

/// The lines of a page outside of code blocks, from 1.
fn prose(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut code = false;
    (1..).zip(text.lines()).filter(move |(_, line)| {
        let fence = line.trim_start().starts_with("```");
        code ^= fence;
        !code && !fence
    })
}

/// The relative links of a page, with their lines. What is in backticks is no link.
fn links(text: &str) -> impl Iterator<Item = (usize, &str)> {
    prose(text).flat_map(|(number, line)| {
        let parts = line.split('`').step_by(2).flat_map(|part| part.split("](").skip(1));
        let urls = parts.filter_map(|rest| rest.split([')', ' ']).next());
        urls.filter(|url| !url.contains(':') && !url.is_empty()).map(move |url| (number, url))
    })
}

/// The anchors of a page: its headings in lower case without punctuation, blanks as hyphens, the second of a kind with `-1`.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut all = BTreeSet::new();
    let mut times: BTreeMap<String, usize> = BTreeMap::new();
    for (_, line) in prose(text) {
        let heading = line.trim_start_matches('#');
        if heading.len() == line.len() || !heading.starts_with(' ') {
            continue;
        }
        let kept = |c: &char| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_');
        let anchor = shown(heading.trim()).to_lowercase().chars().filter(kept).collect::<String>().replace(' ', "-");
        let before = times.entry(anchor.clone()).or_default();
        all.insert(if *before == 0 { anchor } else { format!("{anchor}-{before}") });
        *before += 1;
    }
    all
}

/// A heading as a reader sees it: the texts of its links alone, without comments.
fn shown(heading: &str) -> String {
    let mut text = String::new();
    let mut rest = heading;
    while let Some(at) = rest.find("<!--").into_iter().chain(rest.find("](")).min() {
        let (before, after) = rest.split_at(at);
        text += before;
        let end = if after.starts_with('<') { "-->" } else { ")" };
        rest = after.split_once(end).map_or("", |(_, behind)| behind);
    }
    text + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(text: &str) -> Result<String, String> {
        let root = std::env::temp_dir().join(format!("edm-links-{}-{:p}", std::process::id(), text));
        std::fs::create_dir_all(root.join("docs")).unwrap();
        let other = "# Other\n\n## Two words, *one* `code`\n\n## The same\n\n```\n## not a heading\n```\n\n## The same\n\n## A [link](x.md) <!--=n-->3<!--/-->\n";
        std::fs::write(root.join("docs/other.md"), other).unwrap();
        std::fs::write(root.join("docs/sheet.pdf"), "").unwrap();
        std::fs::write(root.join("README.md"), text).unwrap();
        std::fs::write(root.join("docs/x.md"), "").unwrap();
        let result = check(&root);
        std::fs::remove_dir_all(root).unwrap();
        result
    }

    #[test]
    fn links_to_files_and_headings_that_exist_pass() {
        for link in [
            "docs/other.md",
            "docs/sheet.pdf",
            "docs/other.md#two-words-one-code",
            "docs/other.md#the-same",
            "docs/other.md#the-same-1",
            "docs/other.md#a-link-3",
            "docs/../docs/other.md#other",
            "#top",
            "https://example.org/missing.md#anywhere",
        ] {
            let found = page(&format!("# Top\n\n[`text`]({link})\n"));
            assert!(found.is_ok(), "{link}: {found:?}");
        }
        assert!(page("# Top\n\n`[text](missing.md)`\n\n```\n[text](missing.md)\n```\n").is_ok(), "code is no link");
    }

    #[test]
    fn a_link_to_no_file_or_no_heading_is_named_with_page_and_line() {
        for (link, why) in [
            ("docs/missing.md", "there is no docs/missing.md"),
            ("other.md", "there is no other.md"),
            ("docs/other.md#pins", "docs/other.md has no heading for #pins"),
            ("docs/other.md#not-a-heading", "docs/other.md has no heading for #not-a-heading"),
            ("docs/other.md#the-same-2", "docs/other.md has no heading for #the-same-2"),
            ("#bottom", "README.md has no heading for #bottom"),
        ] {
            let found = page(&format!("# Top\n\n[text](docs/other.md), [text]({link})\n"));
            assert_eq!(found, Err(format!("README.md:3: {link}: {why}")));
        }
    }
}
