//! The pages of the project as a site that needs no network: README, docs and the pages of the examples, each with
//! the same list of pages beside it. Files keep their places, so that links between them hold as they are.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};
use std::{fs, mem};

use anyhow::{Context, Result};
use pulldown_cmark::{CowStr, Event, HeadingLevel, Options, Parser, Tag, TagEnd, html};

/// A page: where it is in the project, its heading and what is in it.
#[derive(Debug)]
struct Page {
    source: PathBuf,
    title: String,
    body: String,
    /// Names of its headings, as links have them.
    anchors: BTreeSet<String>,
    /// What it links to, as it is written.
    links: Vec<String>,
}

/// Links that lead nowhere, each `page: link`.
pub type Dead = Vec<String>;

/// Write the site of the project in `root` into `out`, unless links lead nowhere: then those.
///
/// # Errors
/// If a page cannot be read or a file cannot be written.
pub fn build(root: &Path, out: &Path) -> Result<Dead> {
    let pages = pages(root)?;
    let known: BTreeMap<&Path, &Page> = pages.iter().map(|page| (page.source.as_path(), page)).collect();
    let (mut dead, mut files) = (Dead::new(), BTreeSet::new());
    for page in &pages {
        for link in page.links.iter().filter(|link| !is_outside(link)) {
            let (file, anchor) = link.split_once('#').unwrap_or((link.as_str(), ""));
            let file = page.resolve(root, file);
            let is_alive = match known.get(file.as_path()) {
                Some(other) => anchor.is_empty() || other.anchors.contains(anchor),
                None => root.join(&file).is_file() && anchor.is_empty(),
            };
            if !is_alive {
                dead.push(format!("{}: {link}", page.source.display()));
            } else if !known.contains_key(file.as_path()) {
                files.insert(file);
            }
        }
    }
    if dead.is_empty() {
        for (place, page) in pages.iter().enumerate() {
            put(&out.join(target(&page.source)), page.html(&pages, place).as_bytes())?;
        }
        for file in files {
            put(&out.join(&file), &fs::read(root.join(&file))?)?;
        }
    }
    Ok(dead)
}

/// The pages in the order of reading: the README, the tutorial, what the README lists, what it does not, the examples,
/// the changes; and what these link to besides.
fn pages(root: &Path) -> Result<Vec<Page>> {
    let readme = Page::read(root, "README.md".into())?;
    let mut sources = vec![readme.source.clone(), "docs/tutorial.md".into()];
    sources.extend(readme.linked(root));
    for (folder, name) in [("docs", ""), ("examples", "README.md")] {
        let entries = fs::read_dir(root.join(folder)).with_context(|| format!("{folder}: cannot be read"))?;
        let mut found = entries
            .map(|entry| {
                let entry = Path::new(folder).join(entry?.file_name());
                Ok(if name.is_empty() { entry } else { entry.join(name) })
            })
            .collect::<Result<Vec<_>>>()?;
        found.retain(|page| is_page(root, page));
        found.sort();
        sources.extend(found);
    }
    sources.push("CHANGELOG.md".into());
    let mut pages: Vec<Page> = Vec::new();
    let (mut next, mut seen) = (0, BTreeSet::new());
    while let Some(source) = sources.get(next).cloned() {
        next += 1;
        if seen.insert(source.clone()) {
            let page = Page::read(root, source)?;
            sources.extend(page.linked(root));
            pages.push(page);
        }
    }
    Ok(pages)
}

fn is_page(root: &Path, file: &Path) -> bool {
    file.extension().is_some_and(|end| end == "md") && root.join(file).is_file()
}

fn is_outside(link: &str) -> bool {
    link.contains("://") || link.starts_with("mailto:")
}

/// Where a page goes.
fn target(source: &Path) -> PathBuf {
    if source.file_name().is_some_and(|name| name == "README.md") {
        source.with_file_name("index.html")
    } else {
        source.with_extension("html")
    }
}

fn put(path: &Path, bytes: &[u8]) -> Result<()> {
    if let Some(folder) = path.parent() {
        fs::create_dir_all(folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
    }
    fs::write(path, bytes).with_context(|| format!("{}: cannot be written", path.display()))
}

/// A heading as a link names it: small letters, blanks as hyphens, nothing else.
fn slug(heading: &str) -> String {
    let kept = |letter: char| letter.is_alphanumeric() || matches!(letter, ' ' | '-' | '_');
    heading.to_lowercase().chars().filter(|letter| kept(*letter)).collect::<String>().replace(' ', "-")
}

impl Page {
    fn read(root: &Path, source: PathBuf) -> Result<Self> {
        let path = root.join(&source);
        let text =
            fs::read_to_string(&path).with_context(|| format!("{}: cannot be read", path.display()))?;
        let mut page = Self {
            source,
            title: String::new(),
            body: String::new(),
            anchors: BTreeSet::new(),
            links: Vec::new(),
        };
        let mut events = Vec::new();
        let (mut heading, mut start) = (None, 0);
        for event in Parser::new_ext(&text, Options::ENABLE_TABLES) {
            match &event {
                Event::Start(Tag::Heading { .. }) => (heading, start) = (Some(String::new()), events.len()),
                Event::Text(text) | Event::Code(text) => {
                    if let Some(heading) = &mut heading {
                        heading.push_str(text);
                    }
                }
                Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) => {
                    page.links.push(dest_url.to_string());
                }
                _ => {}
            }
            let is_end = matches!(event, Event::End(TagEnd::Heading(_)));
            let frame = match event {
                Event::Start(Tag::Table(_)) => Some((true, "<div class=\"wide\">")),
                Event::End(TagEnd::Table) => Some((false, "</div>\n")),
                _ => None,
            };
            let event = page.followed(root, event);
            match frame {
                Some((true, html)) => events.extend([Event::Html(html.into()), event]),
                Some((false, html)) => events.extend([event, Event::Html(html.into())]),
                None => events.push(event),
            }
            if is_end {
                let heading = mem::take(&mut heading).unwrap_or_default();
                page.name_heading(&mut events[start], &heading);
            }
        }
        let mut body = String::new();
        html::push_html(&mut body, events.into_iter());
        page.body = body;
        Ok(page)
    }

    /// Give a heading the name that links have for it.
    fn name_heading(&mut self, start: &mut Event<'_>, heading: &str) {
        let Event::Start(Tag::Heading { level, id, .. }) = start else { return };
        if *level == HeadingLevel::H1 && self.title.is_empty() {
            heading.clone_into(&mut self.title);
        }
        let mut name = slug(heading);
        let same = (1..).map(|i| format!("{}-{i}", slug(heading))).find(|name| !self.anchors.contains(name));
        if self.anchors.contains(&name) {
            name = same.unwrap_or_default();
        }
        self.anchors.insert(name.clone());
        *id = Some(CowStr::from(name));
    }

    /// The pages that it links to.
    fn linked(&self, root: &Path) -> Vec<PathBuf> {
        let inside = self.links.iter().filter(|link| !is_outside(link));
        let files = inside.map(|link| self.resolve(root, link.split('#').next().unwrap_or_default()));
        files.filter(|file| is_page(root, file)).collect()
    }

    /// An event with its link led to the page of the site.
    fn followed<'a>(&self, root: &Path, event: Event<'a>) -> Event<'a> {
        let Event::Start(Tag::Link { link_type, dest_url, title, id }) = event else { return event };
        let to = if is_outside(&dest_url) || dest_url.starts_with('#') {
            dest_url
        } else {
            let (file, anchor) = dest_url.split_once('#').map_or((&*dest_url, None), |(f, a)| (f, Some(a)));
            let is_folder = root.join(self.resolve_plainly(file)).is_dir();
            let mut page = if is_folder {
                format!("{}/index.html", file.trim_end_matches('/'))
            } else {
                file.to_owned()
            };
            if let Some(stem) = page.strip_suffix("README.md") {
                page = format!("{stem}index.html");
            } else if let Some(stem) = page.strip_suffix(".md") {
                page = format!("{stem}.html");
            }
            CowStr::from(page + &anchor.map(|anchor| format!("#{anchor}")).unwrap_or_default())
        };
        Event::Start(Tag::Link { link_type, dest_url: to, title, id })
    }

    /// The file that a link of this page names; a folder stands for its README.
    fn resolve(&self, root: &Path, file: &str) -> PathBuf {
        let path = self.resolve_plainly(file);
        if root.join(&path).is_dir() { path.join("README.md") } else { path }
    }

    fn resolve_plainly(&self, file: &str) -> PathBuf {
        if file.is_empty() {
            return self.source.clone();
        }
        let mut path = self.source.parent().map(Path::to_owned).unwrap_or_default();
        for part in Path::new(file).components() {
            match part {
                Component::ParentDir => drop(path.pop()),
                Component::Normal(name) => path.push(name),
                _ => {}
            }
        }
        path
    }

    /// A link to this page from one that lies in a folder so far up, called by the first part of its title.
    fn link(&self, up: &str, class: &str) -> String {
        let title = escaped(self.title.split(':').next().unwrap_or_default());
        format!("<a{class} href=\"{up}{}\">{title}</a>", target(&self.source).display())
    }

    /// The page with the list of all pages beside it, and those before and after it at its foot.
    fn html(&self, all: &[Self], place: usize) -> String {
        let up = "../".repeat(self.source.components().count() - 1);
        let item = |(i, page): (usize, &Self)| {
            let class = if i == place { " class=\"here\"" } else { "" };
            format!("<li>{}</li>\n", page.link(&up, class))
        };
        let list: String = all.iter().enumerate().map(item).collect();
        let before = place.checked_sub(1).map(|i| format!("<span>← {}</span>", all[i].link(&up, "")));
        let after = all.get(place + 1).map(|page| format!("<span>{} →</span>", page.link(&up, "")));
        format!(
            "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>{}</title>\n\
             <style>\n{STYLE}</style>\n</head>\n<body>\n<nav><ul>\n{list}</ul></nav>\n<main>\n{}\
             <footer>{}{}</footer>\n</main>\n</body>\n</html>\n",
            escaped(&self.title),
            self.body,
            before.unwrap_or_else(|| "<span></span>".to_owned()),
            after.unwrap_or_default()
        )
    }
}

/// A text as HTML shows it.
fn escaped(text: &str) -> String {
    let mut html = String::new();
    // A string takes all that is written to it.
    let _ = pulldown_cmark_escape::escape_html(&mut html, text);
    html
}

const STYLE: &str = include_str!("site.css");

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    fn project(tutorial: &str) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let write = |path: &str, text: &str| put(&folder.path().join(path), text.as_bytes()).unwrap();
        write("README.md", "# All\n\n[more](docs/b.md#two-words) [first](docs/tutorial.md)\n");
        write("CHANGELOG.md", "# Changes\n");
        write("docs/tutorial.md", tutorial);
        write("docs/a.md", "# A\n");
        write("docs/b.md", "# B\n\n## Two `words`!\n\n| x |\n| - |\n| 1 |\n");
        write("docs/pictures/fit.svg", "<svg/>");
        write("examples/line/README.md", "# A line\n");
        folder
    }

    #[test]
    fn pages_link_to_each_other_and_pictures_come_along() {
        let folder = project(
            "# First: steps\n\n[line](../examples/line) [up](../README.md) ![fit](pictures/fit.svg) [here](#first-steps)\n",
        );
        let out = folder.path().join("site");
        assert_eq!(build(folder.path(), &out).unwrap(), Vec::<String>::new());
        let read = |path: &str| fs::read_to_string(out.join(path)).unwrap();
        let tutorial = read("docs/tutorial.html");
        for link in [
            "href=\"../examples/line/index.html\"",
            "href=\"../index.html\"",
            "src=\"pictures/fit.svg\"",
            "id=\"first-steps\"",
        ] {
            assert!(tutorial.contains(link), "{link} is not in {tutorial}");
        }
        assert!(out.join("docs/pictures/fit.svg").is_file());
        assert!(read("index.html").contains("href=\"docs/b.html#two-words\""));
        assert!(read("docs/b.html").contains("<div class=\"wide\"><table>"));
        // Read in this order.
        let order: Vec<usize> = ["All", "First", ">B<", ">A<", "A line", "Changes"]
            .iter()
            .map(|title| tutorial.find(title).unwrap())
            .skip(2)
            .collect();
        assert!(order.is_sorted(), "{order:?}");
    }

    #[test]
    fn a_link_that_leads_nowhere_is_said_with_its_page() {
        let folder = project(
            "# First\n\n[a](a.md#b) [b](c.md) [c](#d) ![d](pictures/none.svg) [e](https://example.org)\n",
        );
        let out = folder.path().join("site");
        let dead = build(folder.path(), &out).unwrap();
        let of = |link: &str| format!("docs/tutorial.md: {link}");
        assert_eq!(dead, ["a.md#b", "c.md", "#d", "pictures/none.svg"].map(of));
        assert!(!out.exists());
    }

    #[test]
    fn a_page_outside_of_the_docs_that_is_linked_is_one_of_the_site() {
        let folder = project("# First\n\n[how](../tests/oracle/README.md#how)\n");
        put(&folder.path().join("tests/oracle/README.md"), b"# Oracles\n\n## How\n").unwrap();
        let out = folder.path().join("site");
        assert_eq!(build(folder.path(), &out).unwrap(), Vec::<String>::new());
        let tutorial = fs::read_to_string(out.join("docs/tutorial.html")).unwrap();
        assert!(tutorial.contains("href=\"../tests/oracle/index.html#how\""));
        assert!(fs::read_to_string(out.join("tests/oracle/index.html")).unwrap().contains("id=\"how\""));
    }
}
