#!/bin/sh
# Writes the key of RFC 8032, section 7.1, test 1 (published, no secret) as PEM with
# OpenSSL 3.0.19. Run in this folder.
seed=9d61b19deffd5a60ba844af492ec2cc44449c5697b326919703bac031cae7f60
printf '302e020100300506032b657004220420%s' "$seed" | xxd -r -p |
    openssl pkey -inform DER -out rfc8032_key.pem
openssl pkey -in rfc8032_key.pem -pubout -out rfc8032_key.pem.pub
