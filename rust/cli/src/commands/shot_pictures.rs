use super::CommandContext;
use super::out_file::{SHOT, check_out};
use super::relight::{Picture, Written, check_picture};
use crate::args::PictureArgs;
use anyhow::bail;
use relume_session::image::{BitDepth, Cell, sheet, write_shown};
use relume_session::{Compute, ListedShot, Method, SessionError, ShotList};
use serde::Serialize;
use std::path::{Path, PathBuf};

#[derive(Serialize)]
struct WrittenShots {
    sheet: Option<PathBuf>,
    shots: Vec<WrittenShot>,
    failed: Vec<FailedShot>,
}

#[derive(Serialize)]
struct WrittenShot {
    name: String,
    #[serde(flatten)]
    files: Option<Written>,
}

#[derive(Serialize)]
struct FailedShot {
    name: String,
    reason: String,
}

/// Relights every shot of a list by the same lights, into pictures, a contact sheet or both. A shot that has no picture
/// keeps no other from its own; all are named in the end.
pub fn relight_shots(
    path: &Path,
    method: Method,
    args: &PictureArgs,
    context: &CommandContext,
) -> anyhow::Result<()> {
    let list = ShotList::read(path)?;
    let outs = outs(&list, args)?;
    if let Some(sheet) = &args.sheet {
        check_out(sheet, "png", "a sheet is written as PNG")?;
    }
    let compute = context.compute()?;
    let mut written = WrittenShots { sheet: args.sheet.clone(), shots: Vec::new(), failed: Vec::new() };
    let mut cells = Vec::new();
    for (shot, out) in list.shots.iter().zip(outs) {
        let name = shot.name.clone();
        match relight_shot(shot, out.as_deref(), method, args, &compute, context) {
            Ok((files, cell)) => {
                written.shots.push(WrittenShot { name, files });
                cells.push(cell);
            }
            Err(error) if is_cancelled(&error) => return Err(error),
            Err(error) => {
                let reason = format!("{error:#}");
                cells.push(Cell { picture: None, name: name.clone(), words: reason.clone() });
                written.failed.push(FailedShot { name, reason });
            }
        }
    }
    if let Some(path) = &args.sheet {
        write_shown(path, &sheet(&cells), BitDepth::Eight)?;
    }
    context.console.result(&text(&written), &written);
    match written.failed.as_slice() {
        [] => Ok(()),
        failed => {
            let named: Vec<_> =
                failed.iter().map(|shot| format!("'{}': {}", shot.name, shot.reason)).collect();
            bail!("{} of {} shots failed: {}", failed.len(), list.shots.len(), named.join("; "))
        }
    }
}

fn is_cancelled(error: &anyhow::Error) -> bool {
    matches!(error.downcast_ref::<SessionError>(), Some(SessionError::Cancelled))
}

/// Files of the shots' pictures; none where only the sheet is wanted.
fn outs(list: &ShotList, args: &PictureArgs) -> anyhow::Result<Vec<Option<PathBuf>>> {
    let Some(out) = &args.out else { return Ok(vec![None; list.shots.len()]) };
    let pattern = out.to_string_lossy();
    if !pattern.contains(SHOT) && list.shots.len() > 1 {
        bail!("{} shots would be written to {pattern}; put {SHOT} into its name", list.shots.len());
    }
    let named = list.file_names().into_iter().map(|name| PathBuf::from(pattern.replace(SHOT, &name)));
    named.map(|path| check_picture(&path).map(|()| Some(path))).collect()
}

fn relight_shot(
    shot: &ListedShot,
    out: Option<&Path>,
    method: Method,
    args: &PictureArgs,
    compute: &Compute,
    context: &CommandContext,
) -> anyhow::Result<(Option<Written>, Cell)> {
    let picture = Picture::relit(&shot.bake, Some(&shot.name), method, args, compute, context)?;
    let files = out.map(|out| picture.write(out, args, context)).transpose()?;
    // A 4K picture is 100 MB as floats, of which a sheet needs none unless it is asked for.
    let shown = args.sheet.as_ref().map(|_| picture.view.apply_image(&picture.relit.combined()));
    let frame = shot.frame.map(|frame| format!(", frame {frame}")).unwrap_or_default();
    Ok((files, Cell { picture: shown, name: shot.name.clone(), words: format!("{}{frame}", shot.camera) }))
}

fn text(written: &WrittenShots) -> String {
    let files = written.shots.iter().filter_map(|shot| shot.files.as_ref());
    let mut lines: Vec<String> =
        files.map(|files| format!("{} and {}", files.exr.display(), files.png.display())).collect();
    lines.extend(
        written.sheet.iter().map(|sheet| format!("{}: {} shots", sheet.display(), written.shots.len())),
    );
    lines.join("\n")
}
