//! The pages of takes beside the page of an audit, in a folder of their own.

use crate::draw::href::href;
use crate::draw::scene::Figure;
use crate::draw::take_page::{TakePage, page_beside, write_take_page};
use crate::io::MotionFile;
use crate::{Error, Result};
use std::path::{Path, PathBuf};

/// Where the pages of takes go.
pub struct TakePages {
    /// The folder of the page of the audit.
    page: PathBuf,
    /// The folder of the pages of takes, beside it.
    folder: PathBuf,
}

impl TakePages {
    /// Those beside a page: for `audit.html`, in `audit_takes`.
    pub fn beside(page: &Path) -> TakePages {
        let stem = page.file_stem().unwrap_or_default().to_string_lossy();
        TakePages {
            page: page.parent().unwrap_or(Path::new("")).to_path_buf(),
            folder: page.with_file_name(format!("{stem}_takes")),
        }
    }

    /// Writes the page of a file, the `number`th; its address from the page of the audit. `None`
    /// where it cannot be played, or where another file stands at its path.
    ///
    /// # Errors
    /// [`Error::Io`]: writing fails.
    pub(crate) fn write(
        &self,
        number: usize,
        name: &str,
        file: &MotionFile,
    ) -> Result<Option<String>> {
        let poses = &file.table.poses;
        let html = TakePage {
            name,
            note: "The take as it is. Centimeters, y up.",
            poses,
            rate: file.rate(),
            bones: &file.bones()?,
            markers: None,
            figures: vec![Figure::new("take", poses.xyz.view())],
            table: None,
        }
        .html()?;
        let Some(html) = html else { return Ok(None) };
        std::fs::create_dir_all(&self.folder).map_err(|e| Error::io(&self.folder, e))?;
        let name = Path::new(name).file_name().unwrap_or_default();
        let name = name.to_string_lossy().replace(char::is_control, "_");
        let path = page_beside(&self.folder.join(format!("{number:03}-{name}")));
        let is_written = write_take_page(&path, Some(&html))?;
        Ok(is_written.then(|| href(&self.page, &path)))
    }
}
