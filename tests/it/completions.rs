//! Completions in the shells themselves, where they are installed.

use crate::common::{bin, command, skipped};
use std::process::{Command, Stdio};

/// Runs a script in a shell, in a folder that holds the completion scripts and `walk.csv`; `None`,
/// recorded as skipped, where the shell is absent.
fn shell(name: &str, script: &str) -> Option<String> {
    let found = Command::new(name)
        .args(["-c", "true"])
        .stderr(Stdio::null())
        .status();
    if !found.is_ok_and(|status| status.success()) {
        skipped(&format!("{name} is not installed"));
        return None;
    }
    let folder = tempfile::tempdir().unwrap();
    for (shell, file) in [
        ("bash", "posing.bash"),
        ("zsh", "_posing"),
        ("fish", "posing.fish"),
    ] {
        let done = command("posing")
            .args(["completions", shell])
            .output()
            .unwrap();
        assert!(done.status.success(), "{shell}");
        std::fs::write(folder.path().join(file), done.stdout).unwrap();
    }
    std::fs::write(folder.path().join("walk.csv"), "").unwrap();
    std::fs::write(folder.path().join("script"), script).unwrap();
    let path = format!("{}:{}", bin().display(), std::env::var("PATH").unwrap());
    // A shell that waits for ever is ended, where there is the means.
    let mut command = if cfg!(target_os = "linux") {
        let mut command = Command::new("timeout");
        command.args(["120", name]);
        command
    } else {
        Command::new(name)
    };
    if name == "zsh" {
        command.arg("-f");
    }
    let out = command
        .arg("script")
        .current_dir(folder.path())
        .env("PATH", path);
    let out = out
        .env("HOME", folder.path())
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let (text, errors) = (
        String::from_utf8_lossy(&out.stdout),
        String::from_utf8_lossy(&out.stderr),
    );
    assert!(out.status.success(), "{name}: {text}{errors}");
    Some(text.into_owned())
}

/// Fails unless each line `WORDS -> OFFERS` of `text` offers what `expected` says.
fn assert_offers(text: &str, expected: &[(&str, &[&str])]) {
    for (words, offers) in expected {
        let line = text
            .lines()
            .find_map(|l| l.strip_prefix(&format!("{words} -> ")));
        let line = line.unwrap_or_else(|| panic!("{words}: {text}"));
        for offer in *offers {
            assert!(
                line.split(' ').any(|word| word == *offer),
                "{words}: {line}"
            );
        }
    }
}

const EXPECTED: &[(&str, &[&str])] = &[
    ("posing co", &["complete", "corrupt", "completions"]),
    ("posing complete --m", &["--model", "--max-gap"]),
    ("posing model in", &["info"]),
];

#[test]
fn bash_completes_commands_flags_and_files() {
    let script = r#"
source ./posing.bash
try() {
    COMP_WORDS=("$@") COMP_CWORD=$(($# - 1)) COMPREPLY=()
    "$(complete -p posing | sed 's/.*-F \([^ ]*\).*/\1/')" posing "${COMP_WORDS[COMP_CWORD]}" "${COMP_WORDS[COMP_CWORD - 1]}"
    echo "$* -> ${COMPREPLY[*]}"
}
try posing co; try posing complete --m; try posing model in; try posing help deno
try posing complete --to ""; try posing complete ""
complete -p posing
type -t complete
"#;
    let Some(text) = shell("bash", script) else {
        return;
    };
    assert_offers(&text, EXPECTED);
    assert_offers(&text, &[("posing complete --to ", &["csv", "npy"])]);
    assert_offers(&text, &[("posing help deno", &["denoise"])]);
    // No word of its own: bash then offers files, as `-o default` says.
    assert!(text.contains("posing complete  -> \n"), "{text}");
    assert!(text.contains("-o default"), "{text}");
    assert!(
        text.ends_with("builtin\n"),
        "complete is no builtin any more: {text}"
    );
}

#[test]
fn fish_completes_commands_flags_and_files() {
    let script = r#"
source ./posing.fish
for line in "posing co" "posing complete --m" "posing model in" "posing complete wa"
    echo "$line -> "(complete -C "$line" | string replace -r '\t.*' '' | string join ' ')
end
"#;
    let Some(text) = shell("fish", script) else {
        return;
    };
    assert_offers(&text, EXPECTED);
    assert_offers(&text, &[("posing complete wa", &["walk.csv"])]);
}

#[test]
fn zsh_completes_commands_and_flags() {
    // A shell on a pseudo terminal completes lines as its editor starts, without a key: zsh
    // completes nothing while more is typed. It then ends, which is what is waited for.
    let script = r#"
cat > inner <<'END'
PROMPT= RPROMPT= fpath=($PWD $fpath)
autoload -Uz compinit
compinit -D -u
zle-line-init() {
    for line in "posing corr" "posing complete --max" "posing model in" "posing help deno"; do
        BUFFER=$line CURSOR=$#line
        zle complete-word
        print -r -- "$line -> [$BUFFER]" >> seen
    done
    BUFFER=exit
    zle accept-line
}
zle -N zle-line-init
END
zmodload zsh/zpty
zpty inner zsh -f -i
zpty -w inner 'source ./inner'
while zpty -r inner said; do :; done
cat seen
"#;
    let Some(text) = shell("zsh", script) else {
        return;
    };
    for expected in [
        "posing corr -> [posing corrupt ]",
        "posing complete --max -> [posing complete --max-gap=",
        "posing model in -> [posing model info ]",
        "posing help deno -> [posing help denoise ]",
    ] {
        assert!(text.contains(expected), "{expected}: {text}");
    }
}

#[test]
fn zsh_keeps_its_own_functions() {
    let script = r#"
for name in ${(f)"$(sed -n 's/^\(_[A-Za-z0-9_-]*\) *() *{.*/\1/p' ./_posing)"}; do
    print -r -- "defines $name"
    for folder in $fpath; do
        [[ -e $folder/$name ]] && print -r -- "zsh owns $name"
    done
done
true
"#;
    let Some(text) = shell("zsh", script) else {
        return;
    };
    assert!(text.contains("defines _posing\n"), "{text}");
    assert!(!text.contains("zsh owns"), "{text}");
}

#[test]
fn no_shell_owns_a_linked_name() {
    let linked = command("posing")
        .args(["list", "--linked"])
        .output()
        .unwrap();
    let linked = String::from_utf8(linked.stdout).unwrap();
    assert!(linked.lines().any(|name| name == "denoise"));
    assert!(!linked.lines().any(|name| name == "complete"));
    for (name, builtins) in [
        ("bash", "compgen -b -k"),
        ("zsh", "print -l ${(k)builtins} ${(k)reswords}"),
        ("fish", "builtin --names"),
    ] {
        let Some(owned) = shell(name, builtins) else {
            continue;
        };
        for name in linked.lines() {
            assert!(!owned.lines().any(|builtin| builtin == name), "{name}");
        }
    }
}
