//! Checks the README and the book in `docs`: pages, links, paths and code; commands and options;
//! the documented JSON.

#[cfg(all(feature = "cli", feature = "rerun"))]
mod commands;
#[cfg(feature = "cli")]
mod json;
#[cfg(feature = "cli")]
#[path = "../support/command.rs"]
#[allow(dead_code, reason = "other tests use more of it")]
mod support;

use std::collections::BTreeSet;
use std::path::{Component, Path, PathBuf};
use std::process::{Command, Stdio};

/// Folders of the repository that pages name.
const FOLDERS: [&str; 8] = [
    "benches/",
    "bindings/",
    "docs/",
    "examples/",
    "recordings/",
    "schemas/",
    "src/",
    "tests/",
];

/// A page of Markdown.
struct Page {
    /// Path from the root of the repository.
    path: PathBuf,
    /// Text outside of fenced blocks.
    prose: String,
    blocks: Vec<Block>,
}

/// A fenced block.
struct Block {
    /// Word after the fence.
    language: String,
    text: String,
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

impl Page {
    fn read(path: &Path) -> Page {
        let text = std::fs::read_to_string(root().join(path)).unwrap();
        let (mut prose, mut blocks) = (String::new(), Vec::<Block>::new());
        let mut inside = false;
        for line in text.lines() {
            match line.trim_start().strip_prefix("```") {
                Some(_) if inside => inside = false,
                Some(language) => {
                    inside = true;
                    blocks.push(Block {
                        language: language.to_owned(),
                        text: String::new(),
                    });
                }
                None => {
                    let to = match inside {
                        true => &mut blocks.last_mut().unwrap().text,
                        false => &mut prose,
                    };
                    to.push_str(line);
                    to.push('\n');
                }
            }
        }
        assert!(!inside, "{}: a block has no end", path.display());
        let path = path.to_owned();
        Page {
            path,
            prose,
            blocks,
        }
    }

    fn name(&self) -> std::path::Display<'_> {
        self.path.display()
    }

    /// Returns the text of each code span, on one line.
    fn spans(&self) -> Vec<String> {
        // Paragraph by paragraph, so that an unpaired backtick affects only its own paragraph.
        let paragraphs = self.prose.split("\n\n");
        let rows = paragraphs.flat_map(|p| match p.starts_with('|') {
            true => p.lines().collect::<Vec<_>>(),
            false => vec![p],
        });
        let spans = rows.flat_map(|row| row.split('`').skip(1).step_by(2).collect::<Vec<_>>());
        let words = |span: &str| span.split_whitespace().collect::<Vec<_>>().join(" ");
        spans.map(|span| words(span).replace("\\|", "|")).collect()
    }

    /// Returns the targets of all links and pictures.
    fn links(&self) -> Vec<&str> {
        let after = self.prose.split("](").skip(1);
        after.filter_map(|rest| rest.split(')').next()).collect()
    }

    /// Returns the anchors of all headings.
    fn anchors(&self) -> BTreeSet<String> {
        let headings = self.prose.lines().filter(|line| line.starts_with('#'));
        let anchor = |line: &str| {
            let title = line.trim_start_matches('#').trim().to_lowercase();
            let kept = title.chars().filter_map(|c| match c {
                ' ' => Some('-'),
                c => (c.is_alphanumeric() || "-_".contains(c)).then_some(c),
            });
            kept.collect()
        };
        headings.map(anchor).collect()
    }
}

/// Returns the files below a folder, from the root.
fn files_in(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(root().join(folder)).unwrap() {
        let entry = entry.unwrap();
        let path = folder.join(entry.file_name());
        match entry.file_type().unwrap().is_dir() {
            true => found.extend(files_in(&path)),
            false => found.push(path),
        }
    }
    found.sort();
    found
}

/// Returns the pages of the book, without its contents.
fn book() -> Vec<Page> {
    let files = files_in(Path::new("docs")).into_iter();
    let is_page = |p: &PathBuf| p.extension().is_some_and(|e| e == "md") && !p.ends_with(SUMMARY);
    files.filter(is_page).map(|p| Page::read(&p)).collect()
}

const SUMMARY: &str = "SUMMARY.md";

/// Returns the book and the other pages, without the changelog, which describes earlier versions.
fn pages() -> Vec<Page> {
    let beside = [
        "README.md",
        "CONTRIBUTING.md",
        "SECURITY.md",
        "benches/README.md",
        "bindings/c/README.md",
        "bindings/python/README.md",
        "recordings/README.md",
    ];
    let beside = beside.iter().map(|path| Page::read(Path::new(path)));
    beside.chain(book()).collect()
}

/// Returns a path without `..` in it.
fn normal(path: &Path) -> PathBuf {
    let mut found = PathBuf::new();
    for part in path.components() {
        match part {
            Component::ParentDir => assert!(found.pop(), "{}", path.display()),
            part => found.push(part),
        }
    }
    found
}

#[test]
fn every_page_is_in_the_contents_once() {
    let contents = Page::read(&Path::new("docs").join(SUMMARY));
    let mut listed: Vec<PathBuf> = contents.links().iter().map(PathBuf::from).collect();
    listed.sort();
    let pages = book().into_iter().map(|page| page.path);
    let pages: Vec<PathBuf> = pages
        .map(|path| path.strip_prefix("docs").unwrap().to_owned())
        .collect();
    assert_eq!(listed, pages);
}

#[test]
fn links_lead_to_files_and_headings() {
    for page in pages() {
        let folder = page.path.parent().unwrap();
        for link in page.links() {
            if link.contains("://") {
                continue;
            }
            let (path, anchor) = link.split_once('#').unwrap_or((link, ""));
            let target = match path {
                "" => page.path.clone(),
                path => normal(&folder.join(path)),
            };
            let of = format!("{}: {link}", page.name());
            assert!(root().join(&target).exists(), "{of}: no such file");
            if page.path.starts_with("docs") {
                assert!(target.starts_with("docs"), "{of}: not in the book");
            }
            if !anchor.is_empty() {
                let anchors = Page::read(&target).anchors();
                assert!(anchors.contains(anchor), "{of}: no such heading");
            }
        }
    }
}

#[test]
fn every_picture_is_shown() {
    let folder = Path::new("docs/pictures");
    let shown: BTreeSet<PathBuf> = pages()
        .iter()
        .flat_map(|page| {
            let folder = page.path.parent().unwrap();
            let links = page.links().into_iter().filter(|l| !l.contains("://"));
            let paths = links.map(|l| folder.join(l.split('#').next().unwrap()));
            paths.map(|path| normal(&path)).collect::<Vec<_>>()
        })
        .collect();
    for picture in files_in(folder) {
        assert!(shown.contains(&picture), "{}", picture.display());
    }
}

#[test]
fn paths_in_code_exist() {
    for page in pages() {
        let blocks = page.blocks.iter().filter(|block| block.language == "sh");
        let words = page
            .spans()
            .into_iter()
            .chain(blocks.map(|b| b.text.clone()));
        for text in words {
            for word in text.split_whitespace() {
                let path = word.trim_matches(|c: char| !c.is_alphanumeric());
                let named = FOLDERS.iter().any(|folder| word.starts_with(folder));
                // `schemas/*.binpb` stands for several.
                let path = path.split('*').next().unwrap();
                if named {
                    let found = root().join(path).exists();
                    assert!(found, "{}: {word}: no such file", page.name());
                }
            }
        }
    }
}

/// rustdoc compiles blocks without a language as Rust.
#[test]
fn every_block_names_its_language() {
    for page in pages() {
        for block in &page.blocks {
            let known = [
                "c", "console", "cpp", "json5", "python", "rust", "sh", "text", "toml", "yaml",
            ];
            let language = block.language.as_str();
            assert!(known.contains(&language), "{}: {language:?}", page.name());
        }
    }
}

#[test]
fn pages_with_rust_code_are_doctests() {
    let lib = std::fs::read_to_string(root().join("src/lib.rs")).unwrap();
    for page in pages() {
        if page.blocks.iter().any(|block| block.language == "rust") {
            let included = format!("include_str!(\"../{}\")", page.name());
            assert!(lib.contains(&included), "{}", page.name());
        }
    }
}

#[test]
fn functions_of_c_exist() {
    let header = root().join("bindings/c/include/linkwatch.h");
    let header = std::fs::read_to_string(header).unwrap();
    for page in pages() {
        for span in page.spans() {
            let is_name = |c: char| c.is_ascii_alphanumeric() || c == '_';
            for word in span.split(|c| !is_name(c)) {
                // `lw_begin_*` stands for several.
                let known = header.contains(word);
                assert!(!word.starts_with("lw_") || known, "{}: {word}", page.name());
            }
        }
    }
}

/// Regression test: an example freed the client twice.
#[test]
fn programs_in_c_use_no_client_after_its_end() {
    for page in pages() {
        for block in page.blocks.iter().filter(|block| block.language == "c") {
            if let Some((_, rest)) = block.text.split_once("lw_finish(client") {
                assert!(!rest.contains("(client"), "{}: {rest}", page.name());
            }
        }
    }
}

#[test]
fn programs_in_c_and_cpp_compile() {
    let languages = [("c", "cc", "c", "c11"), ("cpp", "c++", "c++", "c++17")];
    for (language, compiler, kind, standard) in languages {
        let mut compile = Command::new(compiler);
        compile.args(["-fsyntax-only", "-Wall", "-Wextra", "-Werror"]);
        compile.args(["-x", kind, &format!("-std={standard}"), "-"]);
        compile.arg("-I").arg(root().join("bindings/c/include"));
        for page in pages() {
            for block in page.blocks.iter().filter(|b| b.language == language) {
                compile.stdin(Stdio::piped());
                let mut child = match compile.spawn() {
                    Ok(child) => child,
                    // The library needs a compiler of C, not of C++.
                    Err(_) if language == "cpp" => return,
                    Err(e) => panic!("{compiler}: {e}"),
                };
                let mut stdin = child.stdin.take().unwrap();
                std::io::Write::write_all(&mut stdin, block.text.as_bytes()).unwrap();
                drop(stdin);
                assert!(child.wait().unwrap().success(), "{}", page.name());
            }
        }
    }
}
