package mcclient

import (
	"bytes"
	"errors"
	"fmt"
	"reflect"
	"strconv"
	"strings"
	"unicode/utf8"

	"github.com/vmihailenco/msgpack/v5"
	"github.com/vmihailenco/msgpack/v5/msgpcode"
)

// decode reads one message. The library takes an array for a map, leaves fields that are missing at zero and does not look at the
// encoding of texts: all of these are refused here, as the contract wants it.
func decode[T any](payload []byte) (*T, error) {
	into := new(T)
	name := reflect.TypeFor[T]().Name()
	if err := decodeInto(payload, reflect.ValueOf(into).Elem()); err != nil {
		return nil, notUnderstood(name, err)
	}
	return into, nil
}

func decodeInto(payload []byte, into reflect.Value) (err error) {
	defer func() {
		// whatever bytes a library stumbles over is a message that is not understood, and costs itself only
		if recovered := recover(); recovered != nil {
			err = fmt.Errorf("%v", recovered)
		}
	}()
	reader := bytes.NewReader(payload)
	decoder := msgpack.NewDecoder(reader)
	if err := readStruct(decoder, into); err != nil {
		return err
	}
	if reader.Len() > 0 {
		return fmt.Errorf("%d bytes too many", reader.Len())
	}
	return nil
}

// readStruct reads a map into a struct, field by field.
func readStruct(decoder *msgpack.Decoder, into reflect.Value) error {
	code, err := decoder.PeekCode()
	if err != nil {
		return err
	}
	if !msgpcode.IsFixedMap(code) && code != msgpcode.Map16 && code != msgpcode.Map32 {
		return fmt.Errorf("a map is expected, not %#x", code)
	}
	count, err := decoder.DecodeMapLen()
	if err != nil {
		return err
	}
	missing := map[string]bool{}
	fields := map[string]reflect.Value{}
	for i := range into.NumField() {
		field := into.Type().Field(i)
		name, rule := field.Tag.Get("msgpack"), field.Tag.Get("mc")
		fields[name] = into.Field(i)
		if rule == "required" {
			missing[name] = true
		} else if text, found := strings.CutPrefix(rule, "default="); found {
			setDefault(into.Field(i), text)
		}
	}
	for range count {
		key, err := decoder.DecodeString()
		if err != nil {
			return err
		}
		field, known := fields[key]
		if !known {
			if err := decoder.Skip(); err != nil {
				return err
			}
			continue
		}
		if err := readValue(decoder, field); err != nil {
			return fmt.Errorf("%s: %w", key, err)
		}
		delete(missing, key)
	}
	for name := range missing {
		return fmt.Errorf("%s is missing", name)
	}
	return nil
}

func setDefault(field reflect.Value, text string) {
	if field.Kind() == reflect.String {
		field.SetString(text)
	} else if number, err := strconv.ParseFloat(text, 64); err == nil {
		field.SetFloat(number)
	}
}

func readValue(decoder *msgpack.Decoder, into reflect.Value) error {
	switch into.Kind() {
	case reflect.Struct:
		return readStruct(decoder, into)
	case reflect.Pointer:
		if code, err := decoder.PeekCode(); err != nil || code == msgpcode.Nil {
			return errors.Join(err, decoder.DecodeNil())
		}
		into.Set(reflect.New(into.Type().Elem()))
		return readValue(decoder, into.Elem())
	case reflect.Slice:
		if into.Type().Elem().Kind() == reflect.Uint8 {
			return decoder.DecodeValue(into)
		}
		return readSlice(decoder, into)
	case reflect.String:
		text, err := decoder.DecodeString()
		if err == nil && !utf8.ValidString(text) {
			err = errors.New("the text is no UTF-8")
		}
		into.SetString(text)
		return err
	case reflect.Interface:
		if err := decoder.DecodeValue(into); err != nil || into.Type() != reflect.TypeFor[Value]() {
			return err
		}
		switch into.Interface().(type) {
		case nil, bool, int8, int16, int32, int64, uint8, uint16, uint32, uint64, float32, float64, string:
			return nil
		}
		return errors.New("neither a number nor a text nor a truth value")
	default:
		return decoder.DecodeValue(into)
	}
}

func readSlice(decoder *msgpack.Decoder, into reflect.Value) error {
	code, err := decoder.PeekCode()
	if err != nil {
		return err
	}
	if !msgpcode.IsFixedArray(code) && code != msgpcode.Array16 && code != msgpcode.Array32 {
		return fmt.Errorf("an array is expected, not %#x", code)
	}
	count, err := decoder.DecodeArrayLen()
	if err != nil {
		return err
	}
	// grown as elements come: a length that is claimed and not there costs nothing
	values := reflect.MakeSlice(into.Type(), 0, min(count, 64))
	for range count {
		element := reflect.New(into.Type().Elem()).Elem()
		if err := readValue(decoder, element); err != nil {
			return err
		}
		values = reflect.Append(values, element)
	}
	into.Set(values)
	return nil
}

// Value is a bool, a number (of any of Go's types) or a string: an object of a drive.
type Value any

// Ptr gives a value where a message has a field that may be left out.
func Ptr[T any](value T) *T { return &value }

// paramsOf makes the map of a request: what may be left out and is zero or nil is left out.
func paramsOf(request any) map[string]any {
	params := map[string]any{}
	value := reflect.ValueOf(request)
	for i := range value.NumField() {
		tag, field := value.Type().Field(i).Tag, value.Field(i)
		if tag.Get("mc") == "required" || !field.IsZero() {
			params[tag.Get("msgpack")] = field.Interface()
		}
	}
	return params
}
