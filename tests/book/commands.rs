//! Checks the commands and options in the pages of the book against the help of the command.

use super::support::linkwatch;
use super::{Page, book, pages};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// Options in code spans that belong to other programs or to examples.
const FOREIGN: [&str; 9] = [
    "--",
    "--live",
    "--pid",
    "--poll",
    "--restart",
    "--rm",
    "--shm-size",
    "--substeps",
    "--userns",
];

/// The help of the command `linkwatch`: its subcommands, and the options of each.
struct Help {
    /// The options of each subcommand. Those before a subcommand are under `""`.
    options: BTreeMap<String, BTreeMap<String, Takes>>,
    /// The help texts of all commands.
    text: String,
}

/// Value of an option.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Takes {
    /// None, or one that may be absent.
    Nothing,
    Value,
    /// A value, and settings after a comma: `run.mcap,every=10`.
    Settings,
}

impl Help {
    fn read() -> Help {
        let help = |args: &[&str]| {
            let run = linkwatch(args);
            assert_eq!(run.code, 0, "{}", run.stderr);
            run.stdout
        };
        let top = help(&["--help"]);
        let mut options = BTreeMap::from([(String::new(), options_of(&top))]);
        let mut text = String::new();
        for name in commands_of(&top) {
            let of_command = help(&[&name, "--help"]);
            let mut known = options_of(&of_command);
            // `measure thickness` and the like.
            for part in commands_of(&of_command) {
                known.extend(options_of(&help(&[&name, &part, "--help"])));
            }
            options.insert(name, known);
            text += &of_command;
        }
        Help { options, text }
    }

    fn commands(&self) -> BTreeSet<&str> {
        let names = self.options.keys().map(String::as_str);
        names.filter(|name| !name.is_empty()).collect()
    }

    /// Checks a command line. Returns its error, if it has one. `words` begin after `linkwatch`.
    fn problem(&self, words: &[&str]) -> Option<String> {
        let mut command = "";
        let mut takes = Takes::Nothing;
        for word in words {
            let word = word.trim_matches(['[', ']']);
            match std::mem::replace(&mut takes, Takes::Nothing) {
                Takes::Nothing => {}
                Takes::Value => continue,
                Takes::Settings => {
                    let names = word
                        .split(',')
                        .skip(1)
                        .map(|s| s.split('=').next().unwrap());
                    let described = |name: &str, sign| self.text.contains(&format!("{name}{sign}"));
                    // `every=N: ..` or `motion: ..`.
                    let unknown = |n: &&str| !described(n, '=') && !described(n, ':');
                    if let Some(name) = names.into_iter().find(unknown) {
                        return Some(format!("no setting {name}"));
                    }
                    continue;
                }
            }
            if !word.starts_with('-') || word == "-" {
                // Checks the first word, unless it is the placeholder of any command.
                if command.is_empty() && word != "COMMAND" {
                    match self.options.get_key_value(word) {
                        Some((name, _)) => command = name,
                        None => return Some(format!("no command {word}")),
                    }
                }
                continue;
            }
            let (name, given) = word.split_once('=').unwrap_or((word, ""));
            match self.options[command].get(name) {
                Some(of) if given.is_empty() => takes = *of,
                Some(_) => {}
                None => return Some(format!("no option {name} of `{command}`")),
            }
        }
        None
    }
}

/// Returns the commands in a help text.
fn commands_of(help: &str) -> Vec<String> {
    let lines = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    let lines = lines.take_while(|line| !line.is_empty());
    let names = lines.filter_map(|line| line.strip_prefix("  ")?.split(' ').next());
    let names = names.filter(|name| !name.is_empty() && *name != "help");
    names.map(str::to_owned).collect()
}

/// Returns the options in a help text.
fn options_of(help: &str) -> BTreeMap<String, Takes> {
    let mut found = BTreeMap::new();
    for line in help.lines() {
        let line = line.trim();
        if let Some(alias) = line
            .strip_prefix("[alias: ")
            .or(line.strip_prefix("[aliases: "))
        {
            for name in alias.trim_end_matches(']').split(", ") {
                found.insert(name.to_owned(), Takes::Value);
            }
        }
        if !line.starts_with('-') {
            continue;
        }
        // Format: `-o, --output <FILE>  Write ..`. Optional values are in brackets.
        let (names, _) = line.split_once("  ").unwrap_or((line, ""));
        let takes = match names.contains(" <") && !names.contains(" [<") {
            true if names.contains("[,..]") => Takes::Settings,
            true => Takes::Value,
            false => Takes::Nothing,
        };
        for name in names.split([' ', ',', '[', '=']) {
            if name.starts_with('-') {
                found.insert(name.to_owned(), takes);
            }
        }
    }
    found
}

/// Returns the words of a line of a shell, quotes removed, up to a comment.
fn words(line: &str) -> Vec<String> {
    let (mut found, mut word, mut quote) = (Vec::new(), String::new(), None);
    for c in line.chars() {
        match (quote, c) {
            (Some(q), c) if q == c => quote = None,
            (None, '\'' | '"') => quote = Some(c),
            (None, '#') if word.is_empty() => break,
            (None, c) if c.is_whitespace() => found.push(std::mem::take(&mut word)),
            (_, c) => word.push(c),
        }
    }
    found.push(word);
    found.retain(|word| !word.is_empty());
    found
}

/// Returns the lines of the shell in the blocks of a page, with continued lines joined.
fn lines(page: &Page) -> Vec<String> {
    let mut found = Vec::new();
    for block in &page.blocks {
        let text = block.text.replace("\\\n", " ");
        match block.language.as_str() {
            "sh" => found.extend(text.lines().map(str::to_owned)),
            "console" => {
                let typed = text.lines().filter_map(|line| line.strip_prefix("$ "));
                found.extend(typed.map(str::to_owned));
            }
            _ => {}
        }
    }
    found
}

#[test]
fn commands_and_options_exist() {
    let help = Help::read();
    let (mut checked, mut problems) = (0, Vec::new());
    for page in pages() {
        for line in lines(&page).into_iter().chain(page.spans()) {
            let words = words(&line);
            let is_end = |word: &String| ["&&", "||", "|", ";", "&", ">"].contains(&word.as_str());
            for words in words.split(is_end) {
                let words: Vec<&str> = words.iter().map(String::as_str).collect();
                if let ["linkwatch", rest @ ..] = &words[..] {
                    let problem = help.problem(rest);
                    problems.extend(problem.map(|p| format!("{}: {line}: {p}", page.name())));
                    checked += 1;
                }
            }
        }
    }
    assert!(problems.is_empty(), "{problems:#?}");
    assert!(checked > 80, "{checked}");
}

/// Options alone (`--events`), and commands with an option (`check --junit FILE`).
#[test]
fn options_in_the_text_exist() {
    let help = Help::read();
    // The design pages also use options of the measuring program.
    let mut pages = book();
    pages.retain(|page| !page.path.starts_with("docs/design"));
    pages.push(Page::read(Path::new("README.md")));
    let mut problems = Vec::new();
    for page in pages {
        for span in page.spans() {
            let words: Vec<&str> = span.split(' ').collect();
            let mut problem = None;
            let name = words[0].split(['=', '[']).next().unwrap();
            if name.starts_with("--") && !FOREIGN.contains(&name) {
                // An option of any command; `""` has only those that all have.
                let commands = help.commands().into_iter();
                let mut problems = commands.map(|c| help.problem(&[&[c], &words[..]].concat()));
                if problems.all(|problem| problem.is_some()) {
                    problem = Some("in no command".to_owned());
                }
            } else if help.commands().contains(words[0]) && span.contains(" --") {
                problem = help.problem(&words);
            }
            problems.extend(problem.map(|p| format!("{}: {span}: {p}", page.name())));
        }
    }
    assert!(problems.is_empty(), "{problems:#?}");
}

#[test]
fn the_page_of_the_command_has_all_commands() {
    let help = Help::read();
    let page = Page::read(Path::new("docs/reference/command.md"));
    let rows = page.prose.lines().filter(|line| line.starts_with("| `"));
    let names: BTreeSet<String> = rows
        .flat_map(|row| {
            let cell = row.split(" | ").next().unwrap();
            let spans = cell.split('`').skip(1).step_by(2);
            spans.map(|span| span.split(' ').next().unwrap().to_owned())
        })
        .collect();
    // Another table has the options.
    let names = names.iter().map(String::as_str);
    let names: BTreeSet<&str> = names.filter(|name| !name.starts_with('-')).collect();
    assert_eq!(names, help.commands());
}
