"""A conversation with a stream over a WebSocket: text as it is written and sound as it is made go in, events come out.

What is wrong with a message is answered by a problem document (`type` "problem") and changes nothing else; who does not
stop sending such messages is disconnected.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Collection
from contextlib import ExitStack
from typing import Any, Protocol

import structlog
from fastapi import APIRouter, WebSocket, WebSocketDisconnect
from fastapi.exceptions import RequestValidationError

from app.align.live_sound import LiveSound
from app.api import problems
from app.api.live import SEND_SECONDS, event_names
from app.api.messages import (
    AudioMessage,
    EndMessage,
    FlushMessage,
    InterruptMessage,
    Message,
    SayMessage,
    TextMessage,
    read,
)
from app.api.schemas import Phase
from app.api.service import Service
from app.engine.avatar import Avatar
from app.errors import Gone, InputError, MaryError, OverCapacity
from app.stream.events import EventName
from app.stream.live import LiveStream
from app.stream.timeline import IdlePhase
from app.stream.utterance import Reading, Script, Utterance
from app.tts.live_text import LiveText

MAX_PROBLEMS = 50
"""Messages of one client that may be wrong."""

FORGOTTEN_SECONDS = 60.0
"""A text or sound with which nobody goes on for so long is complete: what is queued behind it shall be spoken."""

NORMAL, POLICY_VIOLATION, INTERNAL_ERROR, TRY_AGAIN_LATER = 1000, 1008, 1011, 1013  # RFC 6455, 7.4.1

_log = structlog.get_logger("mary.api")

router = APIRouter(prefix="/v1/streams/{stream_id}")


class Feed(Protocol):
    """What an utterance in the making is fed by."""

    def flush(self) -> None: ...

    def end(self) -> None: ...


@router.websocket("/ws")
async def converse(websocket: WebSocket, stream_id: str, types: str = "") -> None:
    """Text, sound and commands in; events, acknowledgements and problems out."""
    service: Service = websocket.app.state.service
    try:
        await service.loaded()
        stream = service.streams.get(stream_id)
        if stream.state == "ended":
            raise Gone("the stream has ended")
        names = event_names(types)
    except MaryError as error:
        await websocket.send_denial_response(problems.answer(error))
        return
    await websocket.accept()
    conversation = Conversation(service, stream, websocket)
    _log.info("a conversation begins", route=router.prefix + "/ws")
    try:
        await conversation.run(names)
    finally:
        conversation.close()
        _log.info("a conversation ends", route=router.prefix + "/ws")


class Conversation:
    """One client of a stream. On the event loop; to be closed.

    Args:
        service: speaks.
        stream: what is talked with.
        websocket: accepted.
    """

    def __init__(self, service: Service, stream: LiveStream, websocket: WebSocket) -> None:
        self._service = service
        self._stream = stream
        self._websocket = websocket
        self._feed: Feed | None = None  # of the utterance that is being written
        self._utterance: Utterance | None = None  # it
        self._seat = ExitStack()  # of live sound
        self._told_over = False  # the client knows that it was cut short
        self._text: LiveText | None = None  # the last one that was written here
        self._sound_cut = False  # what still comes of it is nobody's mistake
        self._problems = 0

    async def run(self, names: Collection[EventName]) -> None:
        """Answer until the client goes, is let go, or the stream ends."""
        telling = asyncio.create_task(self._tell(names))
        listening = asyncio.create_task(self._listen())
        try:
            ended, _ = await asyncio.wait({telling, listening}, return_when=asyncio.FIRST_COMPLETED)
            for task in ended:
                if error := task.exception():
                    _log.error("a conversation failed", error=type(error).__name__)
                    await self._websocket.close(INTERNAL_ERROR)
        finally:
            for task in (telling, listening):
                task.cancel()
            await asyncio.gather(telling, listening, return_exceptions=True)

    def close(self) -> None:
        """The client has gone, or has said all: what it began is complete as it is."""
        if self._feed is not None:
            self._feed.end()
            self._feed = None
        self._seat.close()

    def _cut(self) -> None:
        """What was begun is interrupted; sound may still be on its way here."""
        self._sound_cut = isinstance(self._feed, LiveSound)
        self.close()

    async def _tell(self, names: Collection[EventName]) -> None:
        try:
            async for event in self._stream.events(names):
                if event.name == "speak_ended":
                    await self._tell_unread()
                await self._send({"type": event.name, **event.data})
            await self._websocket.close(NORMAL, "the stream has ended")
        except MaryError as error:
            await self._send(_problem(problems.of_error(error)))
            await self._websocket.close(TRY_AGAIN_LATER if isinstance(error, OverCapacity) else POLICY_VIOLATION)
        except (TimeoutError, WebSocketDisconnect, RuntimeError):
            return  # it takes nothing, or has gone meanwhile

    async def _listen(self) -> None:
        try:
            while True:
                frame = await self._receive()
                if frame["type"] == "websocket.disconnect":
                    return
                await self._take(frame)
                if self._problems > MAX_PROBLEMS:
                    await self._websocket.close(POLICY_VIOLATION, "too many messages were wrong")
                    return
        except (TimeoutError, WebSocketDisconnect, RuntimeError):
            return

    async def _receive(self) -> Any:
        if self._feed is not None:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(FORGOTTEN_SECONDS):
                    return await self._websocket.receive()
            self.close()
        return await self._websocket.receive()

    async def _take(self, frame: Any) -> None:
        try:
            if frame.get("text") is not None:
                await self._obey(read(frame["text"]))
            else:
                self._hear(frame["bytes"])
        except MaryError as error:
            await self._object(problems.of_error(error))
        except RequestValidationError as error:
            await self._object(problems.of_faults(error.errors()))

    async def _obey(self, message: Message) -> None:
        match message:
            case TextMessage():
                await self._write(message)
            case AudioMessage():
                await self._begin_sound(message)
            case FlushMessage():
                self._begun("flush").flush()
            case EndMessage():
                self._begun("end")
                self.close()
            case InterruptMessage():
                self._cut()
                self._stream.interrupt()
            case SayMessage():
                await self._say(message)

    async def _write(self, message: TextMessage) -> None:
        self._service.check_length(message.text)
        if self._feed is None:
            voice = self._service.voice(message.voice, self._stream.avatar).id
            limit = self._service.settings.limits.text
            own = {**self._service.settings.speech.lexicon, **message.lexicon}
            face = await self._service.face(self._stream.avatar, message.trajectory, message.renderer)
            text = LiveText(self._service.engine, voice=voice, speed=message.speed, limit=limit, lexicon=own)
            await self._begin(text, Script(text.speeches()), message.phase, face)
            self._text = text
        feed = self._feed
        if not isinstance(feed, LiveText):
            raise InputError("sound is being sent; text has no place in it", field="type", advice='Send "end" first.')
        if self._is_over():
            return
        feed.push(message.text)
        await self._tell_unread()

    async def _begin_sound(self, message: AudioMessage) -> None:
        if self._feed is not None:
            raise InputError("something else is being sent", field="type", advice='Send "end" or "interrupt" first.')
        transcript = message.transcript or ""
        self._service.check_length(transcript)
        face = await self._service.face(self._stream.avatar, message.trajectory, message.renderer)
        with ExitStack() as taken:
            taken.enter_context(self._service.listening.live_seats.one())
            sound = await self._service.listening.live(message.rate, transcript)
            await self._begin(sound, Script(sound.speeches()), message.phase, face)
            self._seat = taken.pop_all()
        self._text = None

    def _hear(self, data: bytes) -> None:
        if isinstance(self._feed, LiveSound):
            if not self._is_over():
                self._feed.push_audio(data)
        elif not self._sound_cut:
            raise InputError(
                f"{len(data):,} bytes came where a message was due",
                advice='Text frames carry messages; binary ones carry sound after {"type": "audio", "rate": 24000}.',
            )

    async def _say(self, message: SayMessage) -> None:
        self._service.check_length(message.text)
        voice = self._service.voice(message.voice, self._stream.avatar).id if message.voice else ""
        reading = Reading(voice, message.speed, message.lexicon, message.strict, message.markup)
        face = await self._service.face(self._stream.avatar, message.trajectory, message.renderer)
        utterance = self._stream.say(
            message.text, interrupt=message.interrupt, reading=reading, phase=_phase(message.phase), face=face
        )
        if message.interrupt:
            self._cut()
        await self._accept(utterance)

    async def _begin(self, feed: Feed, script: Script, phase: Phase | None, face: Avatar | None) -> None:
        self._utterance = self._stream.speak(script, 0, phase=_phase(phase), face=face)
        self._feed = feed
        self._told_over = self._sound_cut = False
        await self._accept(self._utterance)

    def _begun(self, what: str) -> Feed:
        if self._feed is None:
            raise InputError(f"there is nothing to {what}", field="type", advice='Send "text" or "audio" first.')
        return self._feed

    async def _tell_unread(self) -> None:
        """What cannot be read shows only when it is its turn."""
        text, utterance = self._text, self._utterance
        if text is None or utterance is None:
            return
        utterance.characters = text.characters
        if text.unread != utterance.unread:
            utterance.unread = text.unread
            await self._send({"type": "unread", "utterance": utterance.id, "unread": list(text.unread)})

    def _is_over(self) -> bool:
        """Whether the utterance was cut short by somebody else; the first to hear of it is told by a problem."""
        assert self._utterance is not None
        if not self._utterance.finished:
            return False
        if not self._told_over:
            self._told_over = True
            raise Gone(
                f"utterance {self._utterance.id} was {self._utterance.state}", advice='Send "end", and begin anew.'
            )
        return True

    async def _accept(self, utterance: Utterance) -> None:
        told = {"unread": list(utterance.unread), "guessed": list(utterance.guessed)}
        await self._send({"type": "accepted", "utterance": utterance.id, **told})

    async def _object(self, document: dict[str, str | int]) -> None:
        self._problems += 1
        await self._send(_problem(document))

    async def _send(self, content: dict[str, Any]) -> None:
        async with asyncio.timeout(SEND_SECONDS):
            await self._websocket.send_text(json.dumps(content))


def _problem(document: dict[str, str | int]) -> dict[str, str | int]:
    # The document's own `type` has to make room for the message's.
    return {**document, "type": "problem", "problem": document["type"]}


def _phase(phase: Phase | None) -> IdlePhase | None:
    return IdlePhase(phase.frame, phase.at_ms) if phase else None
