//! Rig of the recorder: an adapter on a pseudo-terminal, a mosquitto, a network that can be cut.

use std::fmt::Write as _;
use std::fs::File;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use loadtwin::can::Model;
use loadtwin_common::io::frame::Frame;
use loadtwin_common::io::raw::RawSample;
use serde_json::Value;
use serialport::{ClearBuffer, SerialPort, TTYPort};

/// A program that ends with the test.
pub struct Program(pub Child);

impl Program {
    /// SIGKILL.
    pub fn kill(&mut self) {
        self.0.kill().expect("killed");
        self.0.wait().expect("ended");
    }

    /// SIGTERM, and what it prints at its end.
    pub fn end(mut self) -> Value {
        let pid = self.0.id().to_string();
        let sent = Command::new("kill").args(["-TERM", &pid]).status();
        assert!(sent.expect("kill").success());
        let status = self.0.wait().expect("ended");
        let said = std::io::read_to_string(self.0.stdout.take().unwrap()).unwrap();
        assert!(status.success(), "{said}");
        println!("{said}");
        serde_json::from_str(&said).expect("a summary")
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A serial adapter: answers commands, and passes on what the bus carries while it is open.
pub struct Adapter {
    pub name: String,
    pub is_open: AtomicBool,
    port: Mutex<TTYPort>,
    // The other end stays open while no recorder runs.
    terminal: TTYPort,
}

impl Adapter {
    pub fn new() -> Arc<Self> {
        let (port, terminal) = TTYPort::pair().expect("a pseudo-terminal");
        let mut commands = port.try_clone_native().expect("the same");
        commands
            .set_timeout(Duration::from_millis(200))
            .expect("a time");
        let adapter = Arc::new(Self {
            name: format!("slcan:{}", terminal.name().expect("a name")),
            is_open: AtomicBool::new(false),
            port: Mutex::new(port),
            terminal,
        });
        let answering = Arc::downgrade(&adapter);
        thread::spawn(move || {
            let (mut line, mut byte) = (Vec::new(), [0]);
            while let Some(adapter) = answering.upgrade() {
                if commands.read_exact(&mut byte).is_err() {
                    continue;
                }
                line.push(byte[0]);
                if byte == *b"\r" {
                    adapter
                        .port
                        .lock()
                        .unwrap()
                        .write_all(b"\r")
                        .expect("answered");
                    if line == b"O\r" {
                        adapter.is_open.store(true, SeqCst);
                    }
                    line.clear();
                }
            }
        });
        adapter
    }

    /// Carries the samples at their rate, with the estimates of a machine.
    pub fn carry(&self, model: &Model<'_>, samples: &[RawSample]) {
        let (mut line, mut encoder) = model.start().expect("a good model");
        let mut status = loadtwin_common::io::frame::Status::new();
        let began = Instant::now();
        for sample in samples {
            let due = began + Duration::from_millis(2) * sample.tick;
            thread::sleep(due.saturating_duration_since(Instant::now()));
            let mut text = String::new();
            let mut put = |frame: Frame| {
                let _ = write!(text, "t{:03X}8", frame.id);
                frame.data.iter().for_each(|byte| {
                    let _ = write!(text, "{byte:02X}");
                });
                text.push('\r');
            };
            encoder.raw(sample, &mut put);
            encoder.estimate(&line.step(sample), &mut put);
            status.tick = sample.tick;
            encoder.heartbeat(&status).into_iter().for_each(put);
            let mut port = self.port.lock().unwrap();
            if self.is_open.load(SeqCst) {
                port.write_all(text.as_bytes()).expect("carried");
            }
        }
    }

    /// From now on the bus carries what nobody receives.
    pub fn close(&self) {
        let _whole_line = self.port.lock().unwrap();
        self.is_open.store(false, SeqCst);
    }

    /// Drops what the killed recorder has not read, as an adapter that is closed does: the next one
    /// would take it for its own.
    pub fn discard(&self) {
        (self.terminal.clear(ClearBuffer::Input)).expect("discarded");
    }
}

/// A free port of this computer.
pub fn free_port() -> u16 {
    let listener = TcpListener::bind(("127.0.0.1", 0)).expect("a port");
    listener.local_addr().expect("bound").port()
}

/// A network between the recorder and the broker, which can be cut: bytes vanish, nothing is closed.
pub fn network(to: u16) -> (u16, Arc<AtomicBool>) {
    let listener = TcpListener::bind(("127.0.0.1", 0)).expect("a port");
    let port = listener.local_addr().expect("bound").port();
    let is_cut = Arc::new(AtomicBool::new(false));
    let cut = Arc::clone(&is_cut);
    thread::spawn(move || {
        for near in listener.incoming().flatten() {
            let Ok(far) = TcpStream::connect(("127.0.0.1", to)) else {
                continue;
            };
            for (from, into) in [(&near, &far), (&far, &near)] {
                let (from, into) = (from.try_clone().unwrap(), into.try_clone().unwrap());
                let cut = Arc::clone(&cut);
                thread::spawn(move || pass_on(from, into, &cut));
            }
        }
    });
    (port, is_cut)
}

fn pass_on(mut from: TcpStream, mut into: TcpStream, cut: &AtomicBool) {
    let mut bytes = [0; 4096];
    let mut has_lost = false;
    from.set_read_timeout(Some(Duration::from_millis(50)))
        .unwrap();
    loop {
        match from.read(&mut bytes) {
            Ok(0) => break,
            Ok(_) if cut.load(SeqCst) => has_lost = true,
            Ok(n) if !has_lost => {
                if into.write_all(&bytes[..n]).is_err() {
                    break;
                }
            }
            Err(e) if e.kind() == std::io::ErrorKind::WouldBlock => {
                if has_lost && !cut.load(SeqCst) {
                    break;
                }
            }
            Ok(_) | Err(_) => break,
        }
    }
    let _ = from.shutdown(std::net::Shutdown::Both);
    let _ = into.shutdown(std::net::Shutdown::Both);
}

/// A mosquitto at `port`, and a subscriber to all that writes to `log`.
pub fn broker(dir: &Path, port: u16, log: &Path) -> (Program, Program) {
    let config = dir.join("mosquitto.conf");
    std::fs::write(
        &config,
        // Without a limit of those under way: what is acknowledged would wait for the subscriber in
        // the memory of the broker, and end with it.
        format!("listener {port} 127.0.0.1\nallow_anonymous true\nmax_inflight_messages 0\n"),
    )
    .unwrap();
    let mosquitto = ["/usr/sbin/mosquitto", "mosquitto"]
        .iter()
        .find_map(|name| {
            Command::new(name)
                .arg("-c")
                .arg(&config)
                .stderr(Stdio::null())
                .spawn()
                .ok()
        });
    let broker = Program(mosquitto.expect("mosquitto; tests/run installs it"));
    let end = Instant::now() + Duration::from_secs(10);
    while TcpStream::connect(("127.0.0.1", port)).is_err() {
        assert!(Instant::now() < end, "mosquitto does not listen");
        thread::sleep(Duration::from_millis(20));
    }
    let subscriber = Command::new("mosquitto_sub")
        .args([
            "-p",
            &port.to_string(),
            "-q",
            "1",
            "-t",
            "loadtwin/#",
            "-F",
            "%t\t%r\t%p",
        ])
        .stdout(File::options().create(true).append(true).open(log).unwrap())
        .spawn()
        .expect("mosquitto_sub; tests/run installs it");
    thread::sleep(Duration::from_millis(500));
    (broker, Program(subscriber))
}

/// The recorder.
pub struct Recorder {
    pub machine: PathBuf,
    pub archive: PathBuf,
    pub every: u32,
    pub broker: u16,
}

impl Recorder {
    /// Starts it, and waits until it has opened the adapter.
    pub fn start(&self, adapter: &Adapter) -> Program {
        self.started(Command::new(env!("CARGO_BIN_EXE_loadtwin")), adapter)
    }

    /// The same where no file may have more than `blocks` of 512 bytes, as on a full disk, until
    /// [`Self::free`].
    pub fn start_on_full_disk(&self, adapter: &Adapter, blocks: u32) -> Program {
        let mut shell = Command::new("sh");
        let script = format!("trap '' XFSZ; ulimit -S -f {blocks}; exec \"$0\" \"$@\"");
        shell.args(["-c", &script, env!("CARGO_BIN_EXE_loadtwin")]);
        self.started(shell, adapter)
    }

    /// Makes room on the disk of one that runs.
    pub fn free(running: &Program) {
        let freed = Command::new("prlimit")
            .args(["--fsize=unlimited:unlimited", "--pid"])
            .arg(running.0.id().to_string())
            .status();
        assert!(freed.expect("prlimit").success());
    }

    fn started(&self, mut program: Command, adapter: &Adapter) -> Program {
        let program = program
            .args([
                "record",
                "--json",
                "--name",
                "bench",
                "--every",
                &self.every.to_string(),
            ])
            .args(["--mqtt", &format!("mqtt://127.0.0.1:{}", self.broker), "-o"])
            .args([&self.archive, &self.machine])
            .arg(&adapter.name)
            .stdout(Stdio::piped())
            .spawn()
            .expect("started");
        let program = Program(program);
        let end = Instant::now() + Duration::from_secs(20);
        while !adapter.is_open.load(SeqCst) {
            assert!(
                Instant::now() < end,
                "the recorder does not open the adapter"
            );
            thread::sleep(Duration::from_millis(5));
        }
        program
    }
}
