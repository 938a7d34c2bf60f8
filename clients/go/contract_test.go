package mcclient

import (
	"encoding/base64"
	"encoding/hex"
	"encoding/json"
	"math"
	"os"
	"path/filepath"
	"reflect"
	"strings"
	"testing"
)

const contract = "../contract"

type message struct {
	Name  string
	Bytes string
	Value any
}

type messageFile struct {
	Vectors    []message
	LaterWords []message `json:"later_words"`
	Refused    []message
}

func readJSON(t *testing.T, name string, into any) {
	t.Helper()
	text, err := os.ReadFile(filepath.Join(contract, name))
	if err != nil {
		t.Fatal(err)
	}
	if err := json.Unmarshal(text, into); err != nil {
		t.Fatalf("%s: %v", name, err)
	}
}

func unhex(t *testing.T, text string) []byte {
	t.Helper()
	payload, err := hex.DecodeString(text)
	if err != nil {
		t.Fatal(err)
	}
	return payload
}

// reader decodes one kind of message into what JSON would give of it.
func reader[T any](payload []byte) (any, error) {
	value, err := decode[T](payload)
	if err != nil {
		return nil, err
	}
	return asJSON(reflect.ValueOf(value).Elem()), nil
}

func asJSON(value reflect.Value) any {
	switch value.Kind() {
	case reflect.Pointer, reflect.Interface:
		if value.IsNil() {
			return nil
		}
		return asJSON(value.Elem())
	case reflect.Struct:
		made := map[string]any{}
		for i := range value.NumField() {
			made[value.Type().Field(i).Tag.Get("msgpack")] = asJSON(value.Field(i))
		}
		return made
	case reflect.Map:
		made := map[string]any{}
		for _, key := range value.MapKeys() {
			made[key.String()] = asJSON(value.MapIndex(key))
		}
		return made
	case reflect.Slice:
		if value.Type().Elem().Kind() == reflect.Uint8 {
			return base64.StdEncoding.EncodeToString(value.Bytes())
		}
		made := []any{}
		for i := range value.Len() {
			made = append(made, asJSON(value.Index(i)))
		}
		return made
	case reflect.Int, reflect.Int8, reflect.Int16, reflect.Int32, reflect.Int64:
		return float64(value.Int())
	case reflect.Uint8, reflect.Uint16, reflect.Uint32, reflect.Uint64:
		return float64(value.Uint())
	case reflect.String:
		return value.String()
	}
	return value.Interface()
}

func TestEveryVectorIsReadAsItsValue(t *testing.T) {
	for name, read := range readers {
		var file messageFile
		readJSON(t, "messages/"+name+".json", &file)
		for _, vector := range append(file.Vectors, file.LaterWords...) {
			value, err := read(unhex(t, vector.Bytes))
			if err != nil {
				t.Errorf("%s, %s: %v", name, vector.Name, err)
			} else if wanted := vector.Value; !same(value, wanted) {
				t.Errorf("%s, %s:\n got  %v\n want %v", name, vector.Name, value, wanted)
			}
		}
	}
}

// same compares as JSON what this version knows: fields that have been added to the wire since are none of its own.
// A map without entries is the same as none.
func same(value, wanted any) bool {
	left, _ := json.Marshal(value)
	right, _ := json.Marshal(known(value, wanted))
	normal := func(text []byte) string { return strings.ReplaceAll(string(text), `"details":{}`, `"details":null`) }
	return normal(left) == normal(right)
}

func known(value, wanted any) any {
	switch made := value.(type) {
	case map[string]any:
		fields, _ := wanted.(map[string]any)
		if fields == nil {
			return wanted
		}
		kept := map[string]any{}
		for name, each := range made {
			if found, there := fields[name]; there {
				kept[name] = known(each, found)
			}
		}
		return kept
	case []any:
		elements, _ := wanted.([]any)
		if len(elements) != len(made) {
			return wanted
		}
		kept := []any{}
		for index, each := range made {
			kept = append(kept, known(each, elements[index]))
		}
		return kept
	}
	return wanted
}

// concerns tells whether a refused vector is about a field that this version has.
func concerns(vector string, fields map[string]bool) bool {
	name, _, found := strings.Cut(vector, " is ")
	return !found || fields[name] || strings.Contains(name, " ")
}

func TestWhatIsNoMessageIsRefused(t *testing.T) {
	var garbage messageFile
	readJSON(t, "garbage.json", &garbage)
	for name, read := range readers {
		var file messageFile
		readJSON(t, "messages/"+name+".json", &file)
		fields := map[string]bool{}
		if first, err := read(unhex(t, file.Vectors[0].Bytes)); err == nil {
			for field := range first.(map[string]any) {
				fields[field] = true
			}
		}
		for _, vector := range append(file.Refused, garbage.Refused...) {
			if !concerns(vector.Name, fields) {
				continue
			}
			if value, err := read(unhex(t, vector.Bytes)); err == nil {
				t.Errorf("%s, %s is taken for %v", name, vector.Name, value)
			} else if Code(err) != CodeNotUnderstood {
				t.Errorf("%s, %s: %v", name, vector.Name, err)
			}
		}
	}
}

func TestSamplesAreReadColumnByColumn(t *testing.T) {
	var file struct {
		Fields  []string
		CycleS  float64 `json:"cycle_s"`
		Vectors []struct {
			Name    string
			Axes    []int64
			Bytes   string
			Seq     int64
			T       float64
			Rows    int
			Columns map[string][]float64
		}
		Refused []struct {
			Axes  []int64
			Bytes string
		}
	}
	readJSON(t, "telemetry.json", &file)
	for _, vector := range file.Vectors {
		samples, err := decodeSamples(unhex(t, vector.Bytes), &TelemetryInfo{Axes: vector.Axes, Fields: file.Fields}, file.CycleS)
		if err != nil {
			t.Fatal(err)
		}
		if samples.Seq != vector.Seq || samples.T != vector.T || samples.Rows != vector.Rows {
			t.Errorf("%s: %+v", vector.Name, samples)
		}
		for name, wanted := range vector.Columns {
			column := samples.Fields[name]
			if len(column) != len(wanted) {
				t.Fatalf("%s, %s: %d numbers", vector.Name, name, len(column))
			}
			for i := range wanted {
				if float64(column[i]) != wanted[i] || math.Signbit(float64(column[i])) != math.Signbit(wanted[i]) {
					t.Errorf("%s, %s[%d]: %v, not %v", vector.Name, name, i, column[i], wanted[i])
				}
			}
		}
	}
	for _, vector := range file.Refused {
		if _, err := decodeSamples(unhex(t, vector.Bytes), &TelemetryInfo{Axes: vector.Axes, Fields: file.Fields}, file.CycleS); Code(err) != CodeNotUnderstood {
			t.Error("a part of a row is taken")
		}
	}
}
