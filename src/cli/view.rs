//! `trimaran view`: from the files of a model to a page in a browser, with nothing to decide in between.

use std::{
    io::{self, Write},
    net::{Ipv4Addr, SocketAddr},
    path::{Path, PathBuf},
};

use trimaran::{config::options, scene_cache::CachedScene};

use super::{
    Failure,
    args::ViewArgs,
    cooking,
    import::{print_report, read},
    printed,
    serve::Service,
};

pub(super) fn run(args: &ViewArgs) -> Result<(), Failure> {
    let scene = scene(args)?;
    let service = Service {
        scene: &scene,
        // A port of the system's choice, for programs of this machine.
        listen: SocketAddr::from((Ipv4Addr::LOCALHOST, 0)),
        token: None,
        metrics: None,
        device: &args.device,
        options: options(&[], toml::Table::new()).map_err(Failure::bad_input)?,
    };
    service.run(|url| {
        printed(writeln!(io::stdout(), "{url}"))?;
        if !args.no_browser && webbrowser::open(url).is_err() {
            eprintln!("trimaran: found no browser to open: open the address above in one");
        }
        Ok(())
    })
}

/// The scene that is to be shown: the one given, or that of the files, cooked if it is not yet.
fn scene(args: &ViewArgs) -> Result<PathBuf, Failure> {
    if let [scene] = &args.files[..]
        && is_cooked(scene)
    {
        return Ok(scene.clone());
    }
    if let Some(scene) = args.files.iter().find(|file| is_cooked(file)) {
        let why = format!("{} is a cooked scene: it is viewed alone, without other files", scene.display());
        return Err(Failure::bad_input(why));
    }
    let cached = CachedScene::of(&args.files, &format!("{:?}", args.reading)).map_err(Failure::bad_input)?;
    if !cached.is_there() {
        let imported = read(&args.files, &args.reading)?;
        print_report(&imported.report);
        cached.make_room().map_err(Failure::broken)?;
        cooking::cook_and_save(&imported.model, &args.reading.cook_options(), cached.path())?;
    }
    Ok(cached.path().to_owned())
}

fn is_cooked(file: &Path) -> bool {
    file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("scene"))
}
