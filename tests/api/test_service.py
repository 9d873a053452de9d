from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from app.api.service import Service
from app.config import Settings
from app.errors import BadPack, ConfigError, NotFound, OverCapacity, TooLong

ROOT = Path(__file__).resolve().parents[2]


def settings(**sections: dict[str, object]) -> Settings:
    chosen: dict[str, dict[str, object]] = {"avatars": {"folder": ROOT / "avatars"}, "speech": {"engine": "mock"}}
    return Settings.model_validate(chosen | sections)


async def test_it_loads_beside_the_event_loop_and_ends() -> None:
    service = Service(settings(limits={"text": 5}))
    service.start()
    assert not service.ready
    await asyncio.gather(service.loaded(), service.loaded())
    assert service.ready
    avatar = await service.avatar(None)
    assert avatar.manifest.id == "mary"
    assert service.voice(None, avatar).engine == "mock"
    with pytest.raises(NotFound):
        await service.avatar("../mary")
    with pytest.raises(NotFound):
        service.voice("nobody", avatar)
    service.check_length("12345")
    with pytest.raises(TooLong, match="6 characters"):
        service.check_length("123456")
    await service.close()
    await service.close()
    assert not service.ready
    with pytest.raises(OverCapacity, match="stopping"):
        await service.loaded()


async def test_what_cannot_be_loaded_is_reported() -> None:
    told = asyncio.Event()
    service = Service(settings(speech={"engine": "parrot"}))
    service.on_failure = told.set
    service.start()
    with pytest.raises(OverCapacity):
        await service.loaded()
    assert told.is_set()
    assert isinstance(service.failure, ConfigError)
    assert "speech.engine: there is no speech engine 'parrot'" in service.failure.message
    await service.close()


@pytest.mark.parametrize("server", ["rtmp://localhost:99999/live", "rtmp://localhost/büro", "rtmp:///live"])
async def test_a_wrong_rtmp_server_in_the_settings_ends_the_start(server: str) -> None:
    chosen = settings()
    push = chosen.push.model_copy(update={"rtmp": server})
    service = Service(chosen.model_copy(update={"push": push}))
    service.start()
    with pytest.raises(OverCapacity):
        await service.loaded()
    assert isinstance(service.failure, ConfigError)
    assert (service.failure.field, "MARY_PUSH__RTMP" in service.failure.advice) == ("push.rtmp", True)
    await service.close()


async def test_a_misspelt_voice_in_the_settings_ends_the_start() -> None:
    service = Service(settings(speech={"engine": "mock", "voice": "mocc"}))
    service.start()
    with pytest.raises(OverCapacity):
        await service.loaded()
    assert isinstance(service.failure, ConfigError)
    assert "mocc" in service.failure.message
    assert "mock" in service.failure.advice
    await service.close()


async def test_the_operator_reads_where_a_damaged_default_avatar_lies(tmp_path: Path) -> None:
    (tmp_path / "mary").mkdir()
    (tmp_path / "mary" / "manifest.json").write_text("{")
    service = Service(settings(avatars={"folder": tmp_path}))
    service.start()
    with pytest.raises(OverCapacity):
        await service.loaded()
    assert isinstance(service.failure, BadPack)
    assert str(tmp_path) in service.failure.message
    await service.close()


async def test_it_can_be_closed_while_it_loads() -> None:
    service = Service(settings())
    service.start()
    early = asyncio.create_task(service.loaded())
    await asyncio.sleep(0)
    await service.close()
    with pytest.raises(OverCapacity):
        await early
    assert service.failure is None
