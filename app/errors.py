"""One exception tree. The API maps it once to RFC 9457 problem documents, the CLI once to a line and an exit code.

- `MaryError`
    - `ConfigError`: config.yaml or an environment variable is wrong
    - `InputError`: the caller's input is wrong (422)
        - `NothingToSay`: no readable text
        - `TooLong`: over a configured limit (413)
        - `TrainingFailed`: a recording cannot be turned into an avatar
    - `NotFound`: unknown avatar, voice, stream, utterance or plug-in (404)
    - `Gone`: it existed and has ended (410)
    - `NotReady`: it is still being made (409)
    - `OverCapacity`: the service is full; says when to come back (503)
    - `BadPack`: an avatar pack is damaged or of another version
    - `MissingExtra`: an optional dependency or voice is not installed; names it (422)
    - `SpeechFailed`: a speech engine failed; names the engine (502)
    - `AlignmentFailed`: an aligner failed; names the aligner (502)
    - `RecognitionFailed`: a recogniser of phones failed; names it (502)
    - `NegotiationFailed`: a WebRTC offer cannot be answered (400)
        - `IceRestartRefused`: a connection cannot be moved to another network path (422)
    - `TrainingStopped`: training could not go on, though nothing is wrong with the recording: a full disk, say
"""

from __future__ import annotations


class MaryError(Exception):
    """Base of all errors that are the user's or the operator's to read.

    Args:
        message: what was wrong and where, in one sentence.
        advice: what to do about it.
        field: the offending field of the request or setting, if there is one.
    """

    status = 500
    slug = "internal"
    title = "Internal error"

    def __init__(self, message: str, *, advice: str = "", field: str = "") -> None:
        super().__init__(message)
        self.message = message
        self.advice = advice
        self.field = field


class ConfigError(MaryError):
    slug, title = "configuration", "Configuration error"


class InputError(MaryError):
    status, slug, title = 422, "invalid-input", "Invalid input"


class NothingToSay(InputError):
    slug, title = "nothing-to-say", "Nothing to say"


class TooLong(InputError):
    status, slug, title = 413, "too-long", "Too long"


class NotFound(MaryError):
    status, slug, title = 404, "not-found", "Not found"


class Gone(MaryError):
    status, slug, title = 410, "gone", "Gone"


class NotReady(MaryError):
    status, slug, title = 409, "not-ready", "Not ready"


class OverCapacity(MaryError):
    """Attributes: retry_after: seconds after which to try again."""

    status, slug, title = 503, "over-capacity", "Over capacity"
    retry_after: int = 5


class BadPack(MaryError):
    slug, title = "bad-pack", "Damaged avatar pack"


class MissingExtra(MaryError):
    status, slug, title = 422, "missing-extra", "Optional part not installed"


class SpeechFailed(MaryError):
    status, slug, title = 502, "speech-failed", "Speech engine failed"


class AlignmentFailed(MaryError):
    status, slug, title = 502, "alignment-failed", "Alignment failed"


class RecognitionFailed(MaryError):
    status, slug, title = 502, "recognition-failed", "Recognition failed"


class NegotiationFailed(MaryError):
    status, slug, title = 400, "negotiation-failed", "WebRTC negotiation failed"


class IceRestartRefused(NegotiationFailed):
    status, slug, title = 422, "ice-restart-refused", "ICE restart refused"


class TrainingFailed(InputError):
    slug, title = "training-failed", "Training failed"


class TrainingStopped(MaryError):
    slug, title = "training-stopped", "Training stopped"
