"""The command `mary`. An error is one line and an advice; exit code 2 if the input was wrong, 1 for anything else."""

from __future__ import annotations

import runpy
import signal
import sys
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer
from rich.console import Console
from rich.table import Table
from rich.text import Text

from app.config import Settings, load
from app.errors import ConfigError, InputError, MaryError, NotFound

if TYPE_CHECKING:
    from app.engine.avatar import AvatarShelf

# The parts behind the commands (codecs, models, compiled loops) are imported when a command needs them: `mary --help`
# and a wrong option answer at once.

app = typer.Typer(
    name="mary", help="Text in, a talking head out.", no_args_is_help=True, add_completion=False, rich_markup_mode=None
)
_out = Console()
_err = Console(stderr=True)

ConfigOption = Annotated[Path | None, typer.Option("--config", help="Settings file (default: config.yaml).")]


def main() -> None:
    """Run the command that the arguments name."""
    signal.signal(signal.SIGTERM, _terminated)  # so that nothing half-written stays behind; `serve` has its own way
    try:
        app(prog_name="mary")
    except MaryError as error:
        _report(error)
        sys.exit(2 if isinstance(error, InputError | NotFound | ConfigError) else 1)


def _terminated(*_: object) -> NoReturn:
    sys.exit(128 + signal.SIGTERM)


def _report(error: MaryError) -> None:
    _err.print(Text(f"mary: {error.message}"), soft_wrap=True)
    if error.advice:
        _err.print(Text(f"      {error.advice}"), soft_wrap=True)


def _show_version(wanted: bool) -> None:
    if wanted:
        _out.print(f"mary {version('mary')}", highlight=False)
        raise typer.Exit


@app.callback()
def _options(
    _: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    pass


@app.command()
def serve(
    config: ConfigOption = None,
    host: Annotated[str | None, typer.Option(help="Address to listen on.")] = None,
    port: Annotated[int | None, typer.Option(min=0, max=65535, help="Port to listen on; 0 takes a free one.")] = None,
) -> None:
    """Start the service: the page, the HTTP interface, live streams."""
    settings = load(config)
    changed = {key: value for key, value in (("host", host), ("port", port)) if value is not None}
    settings = settings.model_copy(update={"server": settings.server.model_copy(update=changed)})
    from app.api import logs
    from app.api.server import serve as run

    logs.configure()
    run(settings)


@app.command()
def say(
    text: Annotated[str, typer.Argument(help="What to say, or SSML; - reads it from standard input.")] = "",
    output: Annotated[Path, typer.Option("--output", "-o", help="The MP4 file to write.")] = Path("mary.mp4"),
    avatar: Annotated[str | None, typer.Option(help="See: mary avatars.")] = None,
    trajectory: Annotated[str | None, typer.Option(help="What moves the mouth. See: mary avatars.")] = None,
    renderer: Annotated[str | None, typer.Option(help="What draws the mouth: fast, reference.")] = None,
    voice: Annotated[str | None, typer.Option(help="See: mary voices.")] = None,
    speed: Annotated[float, typer.Option(min=0.5, max=2.0, help="1 is the voice's own pace.")] = 1.0,
    lexicon: Annotated[
        list[str] | None, typer.Option(help='How a word is said, WORD=PHONES, e.g. "Nguyen=N UW Y EH N"; repeatable.')
    ] = None,
    audio: Annotated[Path | None, typer.Option(help="Speak with this recording instead of a voice.")] = None,
    said: Annotated[str, typer.Option("--text", help="What the recording says; - reads it. Without: is heard.")] = "",
    strict: Annotated[
        bool, typer.Option("--strict", help="Refuse words no dictionary has, or what the recording does not say.")
    ] = False,
    phones: Annotated[
        Path | None, typer.Option(help="Its phones: JSON list of [symbol, start, end], ARPAbet, seconds.")
    ] = None,
    still: Annotated[bool, typer.Option("--still", help="Keep the head at its rest pose.")] = False,
    config: ConfigOption = None,
) -> None:
    """Render a text, or a recording with its text, with its phone times, or alone, into an MP4 file."""
    settings = load(config)
    if text and said:
        raise InputError("the text is given twice", advice="Give it once, with --text or without.")
    from app.commands.say import Order, run

    order = Order(text or said, audio, phones, avatar, trajectory, renderer, voice, speed, lexicon or (), strict, still)
    run(order, output, settings, out=_out, err=_err)


def _shelf(settings: Settings) -> AvatarShelf:
    from app.engine.avatar import AvatarShelf

    return AvatarShelf(
        settings.avatars.folder, settings.engine.renderer, settings.avatars.default, settings.engine.trajectory
    )


@app.command()
def voices(
    everything: Annotated[bool, typer.Option("--all", help="Of every engine, whether in use or not.")] = False,
    config: ConfigOption = None,
) -> None:
    """List the voices of the speech engine."""
    from app.tts.registry import create
    from app.tts.voices import every_voice

    speech = load(config).speech
    table = Table(box=None, pad_edge=False)
    for column in ("engine", "voice", "language", "sex", "Hz", "licence"):
        table.add_column(column, no_wrap=True)
    notes = []
    if everything:
        found = every_voice(speech.engines)
        listed = [voice for each in found for voice in each.voices]
        notes = [f"{each.engine}: {each.missing}" for each in found if each.missing]
    else:
        listed = list(create(speech.engine, speech.engines.get(speech.engine, {})).voices())
    for each in listed:
        cells = (each.engine, each.id, each.language, each.sex, f"{each.rate:,}", each.licence)
        table.add_row(*map(Text, cells), style="" if each.installed else "dim")
        if not each.installed:
            notes.append(f"{each.engine}: {each.id} is not installed, it needs {each.missing}")
    _out.print(table)
    for note in notes:
        _out.print(Text(note), soft_wrap=True)


@app.command()
def avatars(config: ConfigOption = None) -> None:
    """List the avatars."""
    settings = load(config)
    shelf = _shelf(settings)
    from app.engine.models.pack_models import trajectories

    table = Table("avatar", "title", "picture", "voice", "trajectories", "licence", "", box=None, pad_edge=False)
    for name in shelf.ids():
        try:
            manifest = shelf.manifest(name)
        except MaryError as error:
            table.add_row(name, "", "", "", "", "", Text(error.message, style="red"))
            continue
        note = "default" if name == settings.avatars.default else ""
        size = f"{manifest.width}x{manifest.height}, {manifest.fps:g} fps"
        models = ", ".join(trajectories(manifest))
        table.add_row(name, manifest.title, size, manifest.voice, models, manifest.licence, note)
    _out.print(table)


@app.command()
def train(
    videos: Annotated[list[Path], typer.Argument(help="Videos of one person reading, or folders of them.")],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the avatar: avatars/NAME.")],
    transcripts: Annotated[
        list[Path] | None,
        typer.Option(help="What is said: .txt .align .TextGrid .vtt .srt files, or their folder (default: beside)."),
    ] = None,
    identity: Annotated[Path | None, typer.Option(help="Who it is, as JSON (default: asked for).")] = None,
    title: Annotated[str, typer.Option(help="What people call the avatar.")] = "",
    voice: Annotated[str, typer.Option(help="Its usual voice. See: mary voices.")] = "heart",
    licence: Annotated[str, typer.Option(help="Under which the avatar may be used.")] = "",
    subject: Annotated[str, typer.Option(help="Whose face it is.")] = "",
    consent: Annotated[str, typer.Option(help="What that person agreed to, and when.")] = "",
    background: Annotated[
        Path | None, typer.Option(help="A video loop of the same head with its mouth at rest (default: joined).")
    ] = None,
    leave_out: Annotated[
        str,
        typer.Option(help="Clips (of a single video: numbers of sentences) not to learn from, a,b: for open tests."),
    ] = "",
    models: Annotated[
        str,
        typer.Option(help="Besides gaussian: trajectory models, and selection, a,b (see docs/models.md)."),
    ] = "",
    aligner: Annotated[str, typer.Option(help="Finds when the phones sound.")] = "pocketsphinx",
    seed: Annotated[int, typer.Option(help="Same seed, same avatar.")] = 0,
    workers: Annotated[int, typer.Option(min=0, help="Processes; 0: one a core.")] = 0,
) -> None:
    """Make an avatar of a recording. Interrupted, the same command goes on where it was."""
    from app.commands.train import Asked, run

    run(
        videos, transcripts or [], output, Asked(identity, title, voice, licence, subject, consent),
        background=background, leave_out=_listed(leave_out), models=_listed(models),
        aligner=aligner, seed=seed, workers=workers, out=_out, err=_err,
    )  # fmt: skip


@app.command("evaluate-alignment")
def evaluate_alignment(
    recordings: Annotated[
        list[Path] | None, typer.Argument(help="Videos whose words have times (.align, .TextGrid), or their folders.")
    ] = None,
    sentences: Annotated[int, typer.Option(min=1, max=10_000, help="How many to speak.")] = 100,
    figures: Annotated[Path | None, typer.Option("--json", help="Also write the figures to this file.")] = None,
    config: ConfigOption = None,
) -> None:
    """Measure how right the phone times of every engine and aligner are that is installed."""
    settings = load(config)
    from app.commands.evaluate_alignment import run

    run(settings, recordings or [], count=sentences, figures=figures, out=_out, err=_err)


@app.command()
def evaluate(
    videos: Annotated[list[Path], typer.Argument(help="Videos of the avatar's talker, or folders of them.")],
    avatar: Annotated[str, typer.Option("--avatar", help="See: mary avatars; or the folder of a pack.")],
    transcripts: Annotated[
        list[Path] | None, typer.Option(help="Transcripts (default: beside the videos); may be given several times.")
    ] = None,
    figures: Annotated[Path | None, typer.Option("--json", help="Also write the figures to this file.")] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Also write figures and plots here.")] = None,
    gains: Annotated[str, typer.Option(help="Also measure with the mouth moving so many times as far: 1.1,1.2")] = "",
    models: Annotated[str, typer.Option(help="Trajectory models to compare, a,b (default: all it has).")] = "",
    renderers: Annotated[str, typer.Option(help="Renderers to compare, a,b.")] = "fast",
    sizes: Annotated[
        str, typer.Option(help="Also train the models anew on so many of its sentences, and score them: 50,100,200")
    ] = "",
    seed: Annotated[int, typer.Option(help="Of that training.")] = 0,
    aligner: Annotated[str, typer.Option(help="What finds the phones.")] = "pocketsphinx",
    workers: Annotated[int, typer.Option(min=0, help="Processes; 0: one a core.")] = 0,
    config: ConfigOption = None,
) -> None:
    """Measure how well an avatar says what its talker was recorded saying."""
    folder = _avatar_folder(avatar, load(config))
    from app.commands.evaluate import run

    run(
        videos, transcripts or [], folder, figures=figures, output=output, gains=gains, models=_listed(models),
        renderers=_listed(renderers), sizes=sizes, seed=seed, aligner=aligner, workers=workers, out=_out, err=_err,
    )  # fmt: skip


@app.command()
def align_server(
    host: Annotated[str, typer.Option(help="Address to listen on; there is no password.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="Port to listen on; 0 takes a free one.")] = 8765,
    aligner: Annotated[str, typer.Option(help="What is served.")] = "pocketsphinx",
    workers: Annotated[int, typer.Option(min=1, max=256, help="Sounds aligned at once.")] = 1,
    config: ConfigOption = None,
) -> None:
    """Serve an aligner by XML-RPC to Mary on other machines (align.engine: xmlrpc)."""
    settings = load(config)
    from app.api import logs
    from app.commands.align_server import run

    logs.configure()
    run(aligner, settings.align.aligners.get(aligner, {}), host=host, port=port, workers=workers, out=_out)


def _listed(names: str) -> list[str]:
    """Names with commas between them."""
    return [name.strip() for name in names.split(",") if name.strip()]


def _avatar_folder(avatar: str, settings: Settings) -> Path:
    """The folder of an avatar by its name, or of a pack that lies elsewhere."""
    from app.engine.pack import MANIFEST

    for folder in (settings.avatars.folder / avatar, Path(avatar)):
        if (folder / MANIFEST).is_file():
            return folder
    known = ", ".join(_shelf(settings).ids())
    raise NotFound(f"there is no avatar {avatar!r}", advice=f"Known: {known}; or name the folder of a pack.")


@app.command()
def bench(
    names: Annotated[list[str] | None, typer.Argument(help="Which measurements; none: all.")] = None,
) -> None:
    """Print the measurements, each with its baseline (needs the repository)."""
    root = Path(__file__).resolve().parent.parent
    if not (root / "bench" / "__main__.py").is_file():
        raise NotFound("there is no bench here", advice="Run it in a clone of the repository: make bench.")
    sys.path.insert(0, str(root))
    sys.argv = ["bench", *(names or [])]
    runpy.run_module("bench", run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
