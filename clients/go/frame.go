package mcclient

import (
	"bytes"

	"github.com/vmihailenco/msgpack/v5"
)

func answerOf(frame *frame) reply {
	if frame.ok {
		return reply{value: frame.value}
	}
	refused, err := decode[ErrorReply](frame.failure)
	if err != nil {
		return reply{err: err}
	}
	return reply{err: refusal(refused)}
}

// frame is what comes from the gateway.
type frame struct {
	op                    string
	id                    int64
	ok                    bool
	value, failure        msgpack.RawMessage
	message               msgpack.RawMessage
	client, session, role string
	resumed               bool
}

func readFrame(payload []byte) (*frame, error) {
	decoder := msgpack.NewDecoder(bytes.NewReader(payload))
	count, err := decoder.DecodeMapLen()
	if err != nil {
		return nil, err
	}
	made := &frame{}
	for range count {
		key, err := decoder.DecodeString()
		if err != nil {
			return nil, err
		}
		switch key {
		case "op":
			made.op, err = decoder.DecodeString()
		case "id":
			made.id, err = decoder.DecodeInt64()
		case "ok":
			made.ok, err = decoder.DecodeBool()
		case "value":
			made.value, err = decoder.DecodeRaw()
		case "error":
			made.failure, err = decoder.DecodeRaw()
		case "message":
			made.message, err = decoder.DecodeRaw()
		case "client":
			made.client, err = decoder.DecodeString()
		case "session":
			made.session, err = decoder.DecodeString()
		case "role":
			made.role, err = decoder.DecodeString()
		case "resumed":
			made.resumed, err = decoder.DecodeBool()
		default:
			err = decoder.Skip()
		}
		if err != nil {
			return nil, err
		}
	}
	return made, nil
}
