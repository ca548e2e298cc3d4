//! What handles the requests of the page of `edit`: a session, and the files that it becomes.

use super::figure::Figure;
use super::session_file::SessionPath;
use super::{Handler, Refusal, Reply, Request, Route};
use crate::edit::Session;
use crate::edit::keys::RATE;
use crate::edit::protocol::{Action, PhotographRequest, SolveRequest};
use crate::io::Table;
use crate::io::input::take_name;
use crate::restore::PoseModel;
use crate::{Error, Place, Result};
use posing_core::error::OptionNames;
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// What is edited.
pub struct EditSource {
    /// The model.
    pub model: PoseModel,
    /// The figure.
    pub figure: Figure,
    /// A table whose rows can be edited, with the names of the figure's joints.
    pub table: Option<Table>,
    /// Where the session is kept.
    pub session: Option<PathBuf>,
    /// What the page calls options.
    pub option_names: OptionNames,
}

/// A session that handles requests.
pub struct Editor {
    session: Session,
    figure: Figure,
    /// What is edited, in words.
    name: String,
    rate: f64,
    file: Option<SessionPath>,
    /// The revision that the file holds.
    saved: u64,
    option_names: OptionNames,
}

/// The body of a request to export.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ExportRequest {
    format: String,
    #[serde(default)]
    keys: bool,
}

impl Editor {
    /// Opens a session; one that the file keeps goes on.
    ///
    /// # Errors
    /// The model does not know the figure, the table has no pose, or the file no session; or the
    /// file cannot be kept.
    pub fn open(source: EditSource) -> Result<Editor> {
        let EditSource {
            model,
            figure,
            table,
            session: file,
            option_names,
        } = source;
        let file = file.as_deref().map(SessionPath::open).transpose()?;
        let rig = figure.rig(&model.points)?;
        let mut session = Session::with_model(model, rig);
        let mut rate = RATE;
        let mut name = figure.name.clone();
        if let Some(table) = &table {
            let rows = crate::edit::rows_of_table(session.rig(), &table.poses);
            session
                .edit_rows(rows)
                .map_err(|e| Error::data(Place::file(&table.name), e.to_string()))?;
            rate = table.poses.rate().unwrap_or(rate);
            name = take_name(Path::new(&table.name));
        }
        if let Some(file) = &file
            && let Some(json) = file.read()?
        {
            session.open_json(&json).map_err(|e| file.refused(&e))?;
        }
        Ok(Editor {
            saved: session.revision(),
            session,
            figure,
            name,
            rate,
            file,
            option_names,
        })
    }

    fn state(&self, with_starts: bool) -> Value {
        let mut state = self.session.state_json();
        state.insert("name".into(), json!(self.name));
        state.insert("formats".into(), json!(self.figure.formats()));
        let file = self.file.as_ref().and_then(SessionPath::name);
        state.insert("session".into(), json!(file));
        if with_starts {
            state.insert("starts".into(), self.session.starts_json());
        }
        Value::Object(state)
    }

    fn try_handle(&mut self, request: &Request) -> Result<Reply> {
        let session = &mut self.session;
        Ok(json_reply(&match request.route {
            Route::State => self.state(true),
            Route::Solve => {
                session.solve_request(&parsed::<SolveRequest>(&request.body)?)?;
                session.pose_json(&session.state().pose)
            }
            Route::Act => {
                session.act(&parsed::<Action>(&request.body)?)?;
                self.save()?;
                self.state(false)
            }
            Route::Solutions => session.others_json(),
            Route::Photograph => {
                session.photograph_request(&parsed::<PhotographRequest>(&request.body)?)?
            }
            Route::Between => session.motion_json()?,
            Route::Open => {
                session.open_json(&request.body)?;
                self.save()?;
                self.state(false)
            }
            Route::Export => {
                let ExportRequest { format, keys } = parsed(&request.body)?;
                return self.exported(&format, keys);
            }
        }))
    }

    fn exported(&self, format: &str, keys: bool) -> Result<Reply> {
        let motion = if keys {
            self.session.motion()?
        } else {
            self.session.still(self.rate)
        };
        let (content_type, body) = match format {
            "json" => ("application/json", self.session.to_json().into_bytes()),
            _ => (
                "text/plain; charset=utf-8",
                self.figure.export(&self.session, &motion, format)?,
            ),
        };
        Ok(Reply { content_type, body })
    }

    /// Keeps the session in its file, if it has changed since.
    fn save(&mut self) -> Result<()> {
        if let Some(file) = &self.file
            && self.saved != self.session.revision()
        {
            file.write(&self.session.to_json())?;
            self.saved = self.session.revision();
        }
        Ok(())
    }
}

impl Handler for Editor {
    fn handle(&mut self, request: &Request) -> std::result::Result<Reply, Refusal> {
        self.try_handle(request)
            .map_err(|e| Refusal::new(status(&e), self.option_names.in_text(&e.to_string())))
    }

    fn finish(mut self) -> Result<()> {
        self.session.release();
        self.save()
    }
}

/// 400 for what the request says, 500 for what is not its fault.
fn status(error: &Error) -> u16 {
    match error {
        Error::Usage(_) => 400,
        _ => 500,
    }
}

fn parsed<T: DeserializeOwned>(body: &[u8]) -> Result<T> {
    let body = if body.is_empty() { b"{}" } else { body };
    serde_json::from_slice(body)
        .map_err(|e| Error::usage(format!("the request cannot be read: {e}")))
}

fn json_reply(value: &Value) -> Reply {
    Reply::json(value.to_string().into_bytes())
}
