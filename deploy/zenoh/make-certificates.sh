#!/usr/bin/env bash
# A small certificate authority for one site: the router's certificate, and one for each person or machine.
#   deploy/zenoh/make-certificates.sh FOLDER ROUTER_HOST_OR_IP NAME…
# The NAMEs are the certificates' common names, which zenohd.json5 gives roles to:
#   deploy/zenoh/make-certificates.sh certificates 192.168.1.10 machine operator observer engineer
# Keep FOLDER/authority.key away from every machine: who has it makes new operators.
set -euo pipefail
[ $# -ge 3 ] || { sed -n '2,6s/^# \{0,1\}//p' "$0" >&2; exit 2; }
folder=$1 host=$2
shift 2
days=825
mkdir -p "$folder"
chmod 700 "$folder"
cd "$folder"

if [ ! -f authority.key ]; then
    openssl ecparam -name prime256v1 -genkey -noout -out authority.key
    openssl req -x509 -new -key authority.key -sha256 -days 3650 -subj "/CN=motion site authority" \
        -addext "basicConstraints=critical,CA:TRUE" -addext "keyUsage=critical,keyCertSign,cRLSign" -out authority.pem
fi

issue() { # name, extended key usage, alternative name
    openssl ecparam -name prime256v1 -genkey -noout -out "$1.key"
    openssl req -new -key "$1.key" -subj "/CN=$1" -out "$1.request"
    openssl x509 -req -in "$1.request" -CA authority.pem -CAkey authority.key -CAcreateserial -sha256 -days "$days" \
        -extfile <(printf 'basicConstraints=critical,CA:FALSE\nextendedKeyUsage=%s\nsubjectAltName=%s\n' "$2" "$3") \
        -out "$1.pem"
    rm "$1.request"
}

if [[ $host =~ ^[0-9.]+$ || $host == *:* ]]; then alternative="IP:$host"; else alternative="DNS:$host"; fi
issue router serverAuth,clientAuth "$alternative,DNS:localhost,IP:127.0.0.1"
for name in "$@"; do
    issue "$name" clientAuth "DNS:$name"
done
chmod 600 ./*.key
