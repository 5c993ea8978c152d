"""Writes sealed.bin and key_page.bin: a sealed image and the key page of its board, made without any code of this
project.

Python 3 with `cryptography`; CRC-32 from zlib, SHA-256 from hashlib. The layout is
that of the table in common/src/io/signed_image.rs. Run: python3 sealed.py
"""
import hashlib
import struct
import zlib
from pathlib import Path

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

key = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))
payload = bytes((7 * i + i // 9) % 256 for i in range(300))
machine = hashlib.sha256("Prüfstand 3".encode()).digest()[:8]
signed = b"LTMI" + struct.pack("<IIII", 2, 42, 43, len(payload)) + machine
signed += hashlib.sha256(payload).digest()
body = signed + key.sign(signed) + payload
image = body + struct.pack("<I", zlib.crc32(body))
page = b"LTP2" + key.public_key().public_bytes_raw() + machine
page += struct.pack("<I", zlib.crc32(page))
Path(__file__).with_name("sealed.bin").write_bytes(image)
Path(__file__).with_name("key_page.bin").write_bytes(page)
