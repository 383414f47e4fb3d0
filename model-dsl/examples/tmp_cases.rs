use std::fmt::Write as _;
fn main() {
    for dir in std::fs::read_dir("tests/ui/cases").unwrap() {
        for file in std::fs::read_dir(dir.unwrap().path()).unwrap() {
            let path = file.unwrap().path();
            if path.extension().is_none_or(|e| e != "rs") {
                continue;
            }
            let stderr = path.with_extension("stderr");
            let only_new = std::env::args().nth(1).is_none();
            if only_new && stderr.exists() {
                continue;
            }
            let source = std::fs::read_to_string(&path).unwrap();
            let Some(start) = source.find('{').map(|s| s + 1) else {
                continue;
            };
            let Some(end) = source.find("}\n\nfn main") else {
                continue;
            };
            let blank: String = source[..start]
                .chars()
                .map(|c| if c == '\n' { '\n' } else { ' ' })
                .collect();
            let text = format!("{blank}{}", &source[start..end]);
            let errors = match tau_model_dsl::check_text(&text) {
                Ok(_) => {
                    println!("NO ERROR {}", path.display());
                    continue;
                }
                Err(e) => e,
            };
            let mut out = String::new();
            for (k, d) in errors.diagnostics.iter().enumerate() {
                let (l, c) = (d.line(), d.column());
                let pad = " ".repeat(l.to_string().len());
                let line = source.lines().nth(l - 1).unwrap();
                let n = text[d.byte_range()]
                    .lines()
                    .next()
                    .unwrap()
                    .chars()
                    .count()
                    .max(1);
                if k > 0 {
                    out.push('\n');
                }
                write!(out, "error: {}\n       help: {}\n{pad}--> {}:{l}:{c}\n{pad} |\n{l} | {line}\n{pad} | {}{}\n",
                    d.message, d.help.as_deref().unwrap_or(""),
                    path.strip_prefix("tests/ui").unwrap().display(),
                    " ".repeat(c - 1), "^".repeat(n)).unwrap();
            }
            if only_new {
                println!("=== {}\n{out}", path.display());
                std::fs::write(&stderr, out).unwrap();
            } else if std::fs::read_to_string(&stderr).unwrap() != out {
                println!("DIFF {}\n{out}", path.display());
            }
        }
    }
}
