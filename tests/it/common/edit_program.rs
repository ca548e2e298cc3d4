//! A running `posing edit`.

use super::bin;
use std::io::{BufRead, BufReader};
use std::process::{Child, Command, Stdio};

/// A running `posing edit`, killed when it is dropped.
pub struct Server {
    child: Child,
    /// Its port.
    pub port: u16,
    /// The token of its address.
    pub token: String,
}

impl Server {
    /// One without flags.
    pub fn new() -> Server {
        Server::with(&[])
    }

    /// One with more flags.
    pub fn with(flags: &[&str]) -> Server {
        Server::start(
            Command::new(bin().join("edit"))
                .arg("--no-open")
                .args(flags),
        )
    }

    /// Starts a command, and waits for its address.
    pub fn start(command: &mut Command) -> Server {
        let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        let mut out = BufReader::new(child.stdout.take().unwrap());
        out.read_line(&mut line).unwrap();
        let address = line.trim_end().strip_prefix("http://127.0.0.1:");
        let (port, token) = address.unwrap().split_once("/#token=").unwrap();
        let (port, token) = (port.parse().unwrap(), token.to_string());
        Server { child, port, token }
    }

    /// The address of its page.
    pub fn address(&self) -> String {
        format!("http://127.0.0.1:{}/#token={}", self.port, self.token)
    }

    /// Ends the program by SIGTERM; its exit code.
    pub fn stop(mut self) -> Option<i32> {
        // The shell's own `kill`: small systems have no program of that name.
        let kill = Command::new("sh")
            .args(["-c", &format!("kill {}", self.child.id())])
            .status();
        assert!(kill.unwrap().success());
        self.child.wait().unwrap().code()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
