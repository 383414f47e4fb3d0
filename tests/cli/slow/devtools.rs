//! A browser that is driven over a pipe: the DevTools protocol (<https://chromedevtools.github.io/devtools-protocol>), JSON
//! messages that end with a zero byte.

use std::io::{BufRead, BufReader, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::{env, fs};

use serde_json::{Value, json};
use tempfile::TempDir;

/// Chromium without a window, with one page.
pub(super) struct Browser {
    process: Child,
    to: ChildStdin,
    from: BufReader<ChildStdout>,
    session: Option<String>,
    last: u64,
    /// Messages that answer nothing, since the last page was opened.
    pub(super) events: Vec<Value>,
    _profile: TempDir,
}

/// Names under which systems install it.
const NAMES: [&str; 4] = [
    "chromium",
    "chromium-browser",
    "google-chrome",
    "google-chrome-stable",
];

impl Browser {
    /// Starts the browser; `None`, with a line that says so, where there is none. Where `CI` is set there has to be one.
    pub(super) fn start() -> Option<Self> {
        let path = env::var_os("PATH").unwrap_or_default();
        let mut folders = env::split_paths(&path);
        let found = folders.find_map(|folder| {
            let mut names = NAMES.iter().map(|name| folder.join(name));
            names.find(|file| file.is_file())
        });
        let Some(program) = found else {
            assert!(
                env::var_os("CI").is_none(),
                "no Chromium is installed: `apt-get install chromium`"
            );
            println!("skipped: no Chromium is installed, so that the report was not looked at");
            return None;
        };
        let profile = tempfile::tempdir().unwrap();
        // The browser reads descriptor 3 and writes 4, which a shell can make of standard input and output.
        let options = "--headless --no-sandbox --disable-gpu --no-first-run --hide-scrollbars --disable-dev-shm-usage \
                       --remote-debugging-pipe";
        let mut process = Command::new("sh")
            .args([
                "-c",
                "exec \"$0\" \"$@\" 3<&0 4>&1 </dev/null >/dev/null 2>&1",
            ])
            .arg(program)
            .args(options.split(' '))
            .arg(format!("--user-data-dir={}", profile.path().display()))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let to = process.stdin.take().unwrap();
        let from = process.stdout.take().unwrap();
        let mut browser = Self {
            process,
            to,
            from: BufReader::new(from),
            session: None,
            last: 0,
            events: vec![],
            _profile: profile,
        };
        let target = browser.ask("Target.createTarget", &json!({ "url": "about:blank" }));
        let attach = json!({ "targetId": target["targetId"], "flatten": true });
        let session = browser.ask("Target.attachToTarget", &attach);
        browser.session = session["sessionId"].as_str().map(str::to_owned);
        for domain in ["Page", "Runtime", "Log", "Accessibility"] {
            browser.ask(&format!("{domain}.enable"), &json!({}));
        }
        Some(browser)
    }

    /// Sends a command and waits for its answer.
    #[track_caller]
    pub(super) fn ask(&mut self, method: &str, parameters: &Value) -> Value {
        self.last += 1;
        let mut message = json!({ "id": self.last, "method": method, "params": parameters });
        if let Some(session) = &self.session {
            message["sessionId"] = json!(session);
        }
        write!(self.to, "{message}\0").unwrap();
        self.to.flush().unwrap();
        loop {
            let answer = self.read();
            if answer["id"] != self.last {
                self.events.push(answer);
                continue;
            }
            assert!(answer["error"].is_null(), "{method}: {}", answer["error"]);
            return answer["result"].clone();
        }
    }

    fn read(&mut self) -> Value {
        let mut bytes = Vec::new();
        self.from.read_until(0, &mut bytes).unwrap();
        assert_eq!(bytes.pop(), Some(0), "the browser ended");
        serde_json::from_slice(&bytes).unwrap()
    }

    /// Shows a page at a width (CSS pixels).
    pub(super) fn open(&mut self, page: &str, width: u32, media: &str, scheme: &str) {
        let metrics = json!({
            "width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 600,
        });
        self.ask("Emulation.setDeviceMetricsOverride", &metrics);
        let features = json!([{ "name": "prefers-color-scheme", "value": scheme }]);
        let media = json!({ "media": media, "features": features });
        self.ask("Emulation.setEmulatedMedia", &media);
        self.events.clear();
        self.ask("Page.navigate", &json!({ "url": format!("file://{page}") }));
        let is_loaded = |event: &Value| event["method"] == "Page.loadEventFired";
        while !self.events.iter().any(is_loaded) {
            let event = self.read();
            self.events.push(event);
        }
    }

    /// Value of an expression in the page.
    #[track_caller]
    pub(super) fn evaluate(&mut self, expression: &str) -> Value {
        let asked = json!({ "expression": expression, "returnByValue": true });
        let answer = self.ask("Runtime.evaluate", &asked);
        let failed = &answer["exceptionDetails"];
        assert!(failed.is_null(), "{failed:#}");
        answer["result"]["value"].clone()
    }

    /// Errors and warnings of the page since it was opened.
    pub(super) fn complaints(&mut self) -> Vec<String> {
        // An answer comes behind everything that happened before.
        self.evaluate("0");
        let kinds = [
            "Runtime.exceptionThrown",
            "Log.entryAdded",
            "Runtime.consoleAPICalled",
        ];
        let is_one = |event: &&Value| kinds.iter().any(|kind| event["method"] == *kind);
        let found = self.events.iter().filter(is_one);
        found.map(ToString::to_string).collect()
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// A folder's file as the browser wants it.
pub(super) fn absolute(path: &std::path::Path) -> String {
    fs::canonicalize(path).unwrap().display().to_string()
}
