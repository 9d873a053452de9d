"""What the routes share: avatars, speech engine and streams, loaded beside the event loop while the page is served."""

from __future__ import annotations

import asyncio
import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, TypeVar

import structlog
from fastapi import Depends, Request

from app.align.aligners import Aligners
from app.api.listening import Listening
from app.api.threads import in_thread
from app.api.turns import Turns
from app.config import Settings
from app.engine.avatar import Avatar, AvatarShelf
from app.engine.pool import OrderedPool
from app.errors import BadPack, InputError, MaryError, OverCapacity, TooLong
from app.stream.push.target import check_own_server
from app.stream.streams import Streams
from app.stream.utterance import Reading, Script
from app.tts.engine import SpeechEngine, Voice, check_configured, choose_voice
from app.tts.narrate import narrate
from app.tts.planning import Plan, plan
from app.tts.voicebox import Voicebox, voicebox

RENDERS_AT_ONCE = max(1, (os.cpu_count() or 1) // 2)
"""Files rendered at the same time; the other cores are for live streams."""

RENDERS_WAITING = 8
"""Renders that may wait for their turn; one more is told to come back later."""

T = TypeVar("T")

_log = structlog.get_logger("mary.api")


class Service:
    """Loads what answering needs and ends it again.

    Args:
        settings: of the whole service.

    Attributes:
        shelf, voicebox, pool, streams: there once `loaded` has returned.
        aligners: find phones in recordings, and in speech that comes without.
        listening: hears recordings and live sound.
        render_turns: who may render a file now.
        closing: set when the service begins to end; long work is given up then.
        failure: why loading failed, if it did.
        on_failure: called when loading has failed; a service that cannot speak had better end.
    """

    shelf: AvatarShelf
    voicebox: Voicebox
    pool: OrderedPool
    streams: Streams

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.aligners = Aligners(settings.align.aligners)
        self.listening = Listening(settings, self.aligners)
        self.render_turns = Turns(RENDERS_AT_ONCE, RENDERS_WAITING)
        self.failure: Exception | None = None
        self.on_failure: Callable[[], None] = lambda: None
        self._loading: asyncio.Task[None] | None = None
        self._settled = asyncio.Event()
        self._excused: set[str] = set()  # avatars of which it was told that another model speaks
        self._ready = False
        self.closing = asyncio.Event()

    def start(self) -> None:
        """Begin to load, on the running event loop; returns at once."""
        self._loading = asyncio.create_task(self._load())

    @property
    def engine(self) -> SpeechEngine:
        """What speaks."""
        return self.voicebox.engine

    @property
    def ready(self) -> bool:
        """Everything is loaded, and the service is not ending."""
        return self._ready and not self.closing.is_set()

    async def loaded(self) -> None:
        """Wait until everything is loaded, so that requests in the first seconds are late instead of refused.

        Raises:
            OverCapacity: the service is ending, or it could not be loaded.
        """
        if self._loading is not None:
            await self._settled.wait()
        if not self.ready:
            raise OverCapacity("the service is stopping", advice="Try again in a moment.")

    async def close(self) -> None:
        """End all streams, and with them every long answer to their viewers. May be called again."""
        if self.closing.is_set():
            return
        self.closing.set()
        if self._loading is not None:
            self._loading.cancel()
        if self._ready:
            await self.streams.close()
            self.pool.close()
            await in_thread(self.engine.close)
        await in_thread(self.aligners.close)

    async def avatar(self, name: str | None, *, trajectory: str | None = None, renderer: str | None = None) -> Avatar:
        """The avatar called `name`, loaded; the default one for None.

        Args:
            name: of it.
            trajectory, renderer: what moves and draws its mouth; None: as the settings or the avatar prefer.

        Raises:
            NotFound: there is none of that name, or it has no such model.
            BadPack: its files are damaged; the message names it, only the cause says where it lies.
        """
        wanted = partial(self.shelf.get, trajectory=trajectory, renderer=renderer)
        avatar = await self._from_shelf(wanted, self.shelf.default if name is None else name)
        self._tell_excuse(avatar)
        return avatar

    def _tell_excuse(self, avatar: Avatar) -> None:
        """Once for each avatar, that it does not speak by the model that the settings or its pack name."""
        if avatar.excuse and avatar.manifest.id not in self._excused:
            self._excused.add(avatar.manifest.id)
            _log.warning("another trajectory model speaks", avatar=avatar.manifest.id, detail=avatar.excuse)

    async def face(self, avatar: Avatar, trajectory: str | None, renderer: str | None) -> Avatar | None:
        """An avatar that is there already, as one utterance wants it; None if it wants nothing.

        Raises:
            NotFound: see `avatar`.
        """
        if trajectory is None and renderer is None:
            return None
        return await self.avatar(
            avatar.manifest.id, trajectory=trajectory or avatar.model.name, renderer=renderer or avatar.renderer
        )

    async def avatar_folder(self, name: str) -> Path:
        """Where the files of the avatar called `name` lie; raises as `avatar` does."""
        return await self._from_shelf(self.shelf.folder, name)

    async def _from_shelf(self, take: Callable[[str], T], name: str) -> T:
        # The shelf looks up only names that are in its list, so none can lead out of the folder.
        try:
            return await in_thread(take, name)
        except BadPack as error:
            raise BadPack(f"the avatar {name!r} is damaged", advice="Take another avatar.", field="avatar") from error

    def voice(self, requested: str | None, avatar: Avatar) -> Voice:
        """The voice to speak with: the one asked for, else the configured one, else the avatar's own.

        Raises:
            NotFound: the voice asked for is unknown.
            MissingExtra: it is known but not installed.
        """
        preferred = self.settings.speech.voice or avatar.manifest.voice
        return choose_voice(self.engine, requested or "", preferred)

    def check_length(self, text: str) -> None:
        """Refuse a text that is too long before any work is done on it.

        Raises:
            TooLong: more characters than `limits.text`.
        """
        limit = self.settings.limits.text
        if len(text) > limit:
            raise TooLong(
                f"the text has {len(text):,} characters, at most {limit:,} are taken at once",
                field="text",
                advice="Say it in parts: POST /v1/streams/{id}/say queues them one after another.",
            )

    def plan(self, text: str, reading: Reading) -> Plan:
        """What will be said of a text, with the service's own lexicon behind that of the caller.

        Raises:
            NothingToSay: nothing of it can be read.
            InputError: the lexicon or the SSML is wrong, or (`strict`) a pronunciation had to be guessed.
        """
        own = {**self.settings.speech.lexicon, **reading.lexicon}
        planned = plan(text, markup=reading.markup, lexicon=own)
        if reading.strict and planned.guessed:
            raise InputError(
                f"no dictionary has {', '.join(planned.guessed)[:200]}",
                field="text",
                advice="Give the pronunciation in lexicon, or do without strict.",
            )
        return planned

    def script(self, planned: Plan, reading: Reading) -> Script:
        """The speech of what is planned, made when it is asked for; voice and speed are those of `reading`."""
        speeches = narrate(self.engine, planned, voice=reading.voice, speed=reading.speed)
        return Script(speeches, planned.unread, planned.guessed)

    def _narrator(self, text: str, reading: Reading) -> Script:
        return self.script(self.plan(text, reading), reading)

    async def _load(self) -> None:
        settings = self.settings
        try:
            check_own_server(settings.push.rtmp)
            self.shelf = AvatarShelf(
                settings.avatars.folder, settings.engine.renderer, settings.avatars.default, settings.engine.trajectory
            )
            self.voicebox = await in_thread(voicebox, settings.speech, settings.align, self.aligners)
            check_configured(self.engine, settings.speech.voice)
            self.listening.check()
            self._tell_excuse(await in_thread(self.shelf.get, self.shelf.default))
            await in_thread(self.engine.warm_up)
            await in_thread(plan, "Hello.")  # loads the dictionary
            self.pool = OrderedPool(settings.engine.workers or len(os.sched_getaffinity(0)))
            self.streams = await Streams(settings, self._narrator, self.pool).__aenter__()
        except Exception as error:
            self.failure = error
            self.closing.set()
            detail = error.message if isinstance(error, MaryError) else repr(error)
            _log.error("cannot start", detail=detail)
            self.on_failure()
        else:
            self._ready = True
            _log.info("ready", avatars=list(self.shelf.ids()), speech=self.engine.name)
        finally:
            self._settled.set()


async def _loaded_service(request: Request) -> Service:
    service: Service = request.app.state.service
    await service.loaded()
    return service


LoadedService = Annotated[Service, Depends(_loaded_service)]
"""A route's parameter of this type is the service, once it is loaded."""
