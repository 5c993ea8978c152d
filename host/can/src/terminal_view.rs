//! Draws the `Page` of a command on the bus in the whole terminal, ten times a second: loads with
//! bars, NIS and fault of each sensor, counts. The user ends the command by `q`, Escape or Ctrl-C.

use std::io::{self, Stderr};
use std::ops::ControlFlow;
use std::time::Duration;

use ratatui::backend::CrosstermBackend;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyModifiers};
use ratatui::crossterm::execute;
use ratatui::crossterm::terminal::{
    EnterAlternateScreen, LeaveAlternateScreen, disable_raw_mode, enable_raw_mode,
};
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Style, Stylize};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Gauge, Paragraph};
use ratatui::{Frame, Terminal};

use super::frame_comparison::Verdict;
use super::live_display::{Clock, Page, View};
use loadtwin_common::io::fault::Fault;

/// The terminal on standard error, given back when dropped.
pub(super) struct Screen {
    terminal: Terminal<CrosstermBackend<Stderr>>,
    clock: Clock,
}

impl Screen {
    pub(super) fn new() -> io::Result<Self> {
        enable_raw_mode()?;
        execute!(io::stderr(), EnterAlternateScreen)?;
        let terminal = Terminal::new(CrosstermBackend::new(io::stderr()))?;
        Ok(Self {
            terminal,
            clock: Clock::new(Duration::from_millis(100)),
        })
    }
}

impl Drop for Screen {
    fn drop(&mut self) {
        // Nothing is left to be done where the terminal is gone.
        let _ = disable_raw_mode();
        let _ = execute!(io::stderr(), LeaveAlternateScreen);
    }
}

impl View for Screen {
    fn due(&mut self, now: Duration) -> bool {
        self.clock.due(now)
    }

    fn show(&mut self, page: &Page) -> io::Result<ControlFlow<()>> {
        self.terminal.draw(|frame| draw(frame, page))?;
        while event::poll(Duration::ZERO)? {
            if let Event::Key(key) = event::read()? {
                let interrupt =
                    key.code == KeyCode::Char('c') && key.modifiers.contains(KeyModifiers::CONTROL);
                if interrupt || matches!(key.code, KeyCode::Char('q') | KeyCode::Esc) {
                    return Ok(ControlFlow::Break(()));
                }
            }
        }
        Ok(ControlFlow::Continue(()))
    }
}

fn fault(fault: Fault) -> Span<'static> {
    if fault.is_none() {
        "ok".green()
    } else {
        fault.name().red()
    }
}

pub(super) fn draw(frame: &mut Frame, page: &Page) {
    let [head, loads, sensors, counts] = Layout::vertical([
        Constraint::Length(1),
        Constraint::Length(2 * page.loads.len() as u16 + 2),
        Constraint::Length(page.sensors.len() as u16 + 2),
        Constraint::Min(3),
    ])
    .areas(frame.area());

    frame.render_widget(title(page), head);
    draw_loads(frame, loads, page);
    draw_sensors(frame, sensors, page);
    draw_counts(frame, counts, page);
}

/// Command, machine, verdict and state.
fn title(page: &Page) -> Line<'_> {
    let mut title = vec![format!("loadtwin {} {}  ", page.title, page.machine).bold()];
    if let Some(verdict) = page.verdict {
        let colour = match verdict {
            Verdict::Identical => Color::Green,
            Verdict::Different | Verdict::OtherModel => Color::Red,
            Verdict::Incomplete | Verdict::Nothing => Color::Yellow,
        };
        title.push(Span::styled(
            format!("{verdict:?}  "),
            Style::new().fg(colour),
        ));
    }
    if let Some(status) = page.status {
        title.push(status.state.name().into());
    }
    Line::from(title)
}

/// Value and bar of each load.
fn draw_loads(frame: &mut Frame, loads: Rect, page: &Page) {
    let block = Block::bordered().title("loads");
    // Two rows a load; the layout cuts what the terminal has no room for.
    let inner = Layout::vertical(page.loads.iter().flat_map(|_| [Constraint::Length(1); 2]))
        .split(block.inner(loads));
    frame.render_widget(block, loads);
    for (load, rows) in page.loads.iter().zip(inner.chunks(2)) {
        let text = match (load.value, load.std) {
            (Some(value), Some(std)) => format!("{:24} {value:12.2} +- {std:.2}  ", load.name),
            _ => format!("{:24} {:>12}  ", load.name, "--"),
        };
        let ratio = load.value.unwrap_or(0.0) / load.full_scale;
        let ratio = if ratio.is_finite() {
            ratio.clamp(-1.0, 1.0)
        } else {
            0.0
        };
        let gauge = Gauge::default()
            .ratio(ratio.abs())
            .label(format!("{:.1} %", 100.0 * ratio));
        if let [first, second] = rows {
            frame.render_widget(Line::from(vec![text.into(), fault(load.fault)]), *first);
            frame.render_widget(gauge, *second);
        }
    }
}

/// Innovation and fault of each sensor.
fn draw_sensors(frame: &mut Frame, sensors: Rect, page: &Page) {
    let rows = page.sensors.iter().enumerate().map(|(i, sensor)| {
        let nis = sensor.nis.map_or("--".into(), |nis| format!("{nis:.2}"));
        Line::from(vec![
            format!("sensor {i}  NIS {nis:>10}  ").into(),
            fault(sensor.fault),
        ])
    });
    frame.render_widget(
        Paragraph::new(rows.collect::<Vec<_>>()).block(Block::bordered().title("health")),
        sensors,
    );
}

/// Counts of frames, lag, counters of the board and notes.
fn draw_counts(frame: &mut Frame, counts: Rect, page: &Page) {
    let mut lines: Vec<Line> = page
        .counts
        .iter()
        .map(|(name, count)| format!("{name:16} {count:>12}").into())
        .collect();
    if let Some((mean, most)) = page.lag_ms {
        lines.push(format!("{:16} {mean:>9.2} ms, most {most:.2} ms", "lag").into());
    }
    if let Some(status) = page.status {
        lines.push(
            format!(
                "machine: overruns {}, missed {}, bus-off {}, queue {}",
                status.overruns, status.missed, status.bus_off, status.queue_overflow
            )
            .into(),
        );
    }
    lines.extend(page.note.iter().map(|note| note.as_str().red().into()));
    frame.render_widget(
        Paragraph::new(lines).block(Block::bordered().title("bus  (q ends)")),
        counts,
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live_display::{LoadRow, SensorRow};
    use ratatui::backend::TestBackend;

    fn text(page: &Page, width: u16, height: u16) -> String {
        let mut terminal = Terminal::new(TestBackend::new(width, height)).expect("a terminal");
        terminal.draw(|frame| draw(frame, page)).expect("drawn");
        terminal.backend().to_string()
    }

    #[test]
    fn load_health_and_verdict_are_seen_and_no_size_of_terminal_panics() {
        let mut page = Page::empty("twin");
        page.loads.push(LoadRow {
            name: "main shaft".into(),
            full_scale: 2000.0,
            value: Some(-500.0),
            std: Some(3.0),
            fault: Fault::None,
        });
        page.sensors.push(SensorRow {
            nis: Some(1.25),
            fault: Fault::Stuck,
        });
        page.verdict(Verdict::Identical);
        page.count("frames lost", 7);
        let drawn = text(&page, 80, 24);
        for what in [
            "main shaft",
            "-500.00 +- 3.00",
            "-25.0 %",
            "1.25",
            "stuck",
            "Identical",
            "frames lost",
        ] {
            assert!(drawn.contains(what), "{what} in\n{drawn}");
        }
        for width in [1, 5, 40] {
            for height in 1..12 {
                text(&page, width, height);
            }
        }
    }
}
