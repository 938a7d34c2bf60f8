// A client of another make: connects, browses the machines, tries a write, then prints what changes at
// the first machine.
//
//	client URL [CERTIFICATE KEY USER PASSWORD]
package main

import (
	"context"
	"crypto/rsa"
	"crypto/tls"
	"fmt"
	"os"
	"time"

	"github.com/gopcua/opcua"
	"github.com/gopcua/opcua/id"
	"github.com/gopcua/opcua/ua"
)

func say(format string, values ...any) { fmt.Printf(format+"\n", values...) }

func options(ctx context.Context, args []string) ([]opcua.Option, error) {
	endpoints, err := opcua.GetEndpoints(ctx, args[0])
	if err != nil {
		return nil, err
	}
	policy, token := "None", ua.UserTokenTypeAnonymous
	if len(args) > 1 {
		policy = "Basic256Sha256"
	}
	if len(args) > 3 {
		token = ua.UserTokenTypeUserName
	}
	endpoint, err := opcua.SelectEndpoint(endpoints, policy, ua.MessageSecurityModeInvalid)
	if err != nil {
		return nil, err
	}
	found := []opcua.Option{opcua.SecurityFromEndpoint(endpoint, token), opcua.ReconnectInterval(200 * time.Millisecond)}
	if len(args) > 1 {
		pair, err := tls.LoadX509KeyPair(args[1], args[2])
		if err != nil {
			return nil, err
		}
		found = append(found, opcua.Certificate(pair.Certificate[0]), opcua.PrivateKey(pair.PrivateKey.(*rsa.PrivateKey)))
	}
	if len(args) > 3 {
		return append(found, opcua.AuthUsername(args[3], args[4])), nil
	}
	return append(found, opcua.AuthAnonymous()), nil
}

func look(ctx context.Context, client *opcua.Client) error {
	machinery, err := client.FindNamespace(ctx, "http://opcfoundation.org/UA/Machinery/")
	if err != nil {
		return err
	}
	own, err := client.FindNamespace(ctx, "urn:mcserver:machines")
	if err != nil {
		return err
	}
	folder := client.Node(ua.NewNumericNodeID(machinery, 1001))
	children, err := folder.ReferencedNodes(ctx, id.HierarchicalReferences, ua.BrowseDirectionForward, ua.NodeClassObject, true)
	if err != nil {
		return err
	}
	first := ""
	for _, child := range children {
		name, err := child.BrowseName(ctx)
		if err != nil {
			return err
		}
		say("machine %s", name.Name)
		if first == "" {
			first = name.Name
		}
	}
	state := ua.NewStringNodeID(own, first+":.Monitoring.Channel.ChannelState")
	value := &ua.DataValue{EncodingMask: ua.DataValueValue, Value: ua.MustVariant(int32(2))}
	written, err := client.Write(ctx, &ua.WriteRequest{NodesToWrite: []*ua.WriteValue{
		{NodeID: state, AttributeID: ua.AttributeIDValue, Value: value},
	}})
	if err == nil {
		err = written.Results[0]
	}
	say("write %v", err)
	return watch(ctx, client, own, state)
}

func watch(ctx context.Context, client *opcua.Client, own uint16, state *ua.NodeID) error {
	changes := make(chan *opcua.PublishNotificationData)
	subscription, err := client.Subscribe(ctx, &opcua.SubscriptionParameters{Interval: 50 * time.Millisecond}, changes)
	if err != nil {
		return err
	}
	tool, err := client.FindNamespace(ctx, "http://opcfoundation.org/UA/MachineTool/")
	if err != nil {
		return err
	}
	field := func(namespace uint16, path ...string) *ua.SimpleAttributeOperand {
		names := []*ua.QualifiedName{}
		for _, name := range path {
			names = append(names, &ua.QualifiedName{NamespaceIndex: namespace, Name: name})
			namespace = 0
		}
		base := ua.NewNumericNodeID(0, id.BaseEventType)
		return &ua.SimpleAttributeOperand{TypeDefinitionID: base, BrowsePath: names, AttributeID: ua.AttributeIDValue}
	}
	filter := ua.EventFilter{
		SelectClauses: []*ua.SimpleAttributeOperand{
			field(0, "SourceName"), field(tool, "ErrorCode"), field(0, "ActiveState", "Id"), field(0, "Message"),
		},
		WhereClause: &ua.ContentFilter{Elements: []*ua.ContentFilterElement{}},
	}
	events := opcua.NewMonitoredItemCreateRequestWithDefaults(ua.NewNumericNodeID(0, id.Server), ua.AttributeIDEventNotifier, 2)
	events.RequestedParameters.Filter = &ua.ExtensionObject{
		EncodingMask: ua.ExtensionObjectBinary,
		TypeID:       &ua.ExpandedNodeID{NodeID: ua.NewNumericNodeID(0, id.EventFilter_Encoding_DefaultBinary)},
		Value:        filter,
	}
	_, err = subscription.Monitor(ctx, ua.TimestampsToReturnBoth, events,
		opcua.NewMonitoredItemCreateRequestWithDefaults(state, ua.AttributeIDValue, 1))
	if err != nil {
		return err
	}
	for change := range changes {
		switch found := change.Value.(type) {
		case *ua.DataChangeNotification:
			for _, item := range found.MonitoredItems {
				say("state %v %v", item.Value.Value.Value(), item.Value.Status == ua.StatusOK)
			}
		case *ua.EventNotificationList:
			for _, event := range found.Events {
				fields := event.EventFields
				message, _ := fields[3].Value().(*ua.LocalizedText)
				say("alert %v %v %v %s", fields[0].Value(), fields[1].Value(), fields[2].Value(), message.Text)
			}
		}
	}
	return nil
}

func main() {
	ctx := context.Background()
	found, err := options(ctx, os.Args[1:])
	if err == nil {
		var client *opcua.Client
		if client, err = opcua.NewClient(os.Args[1], found...); err == nil {
			if err = client.Connect(ctx); err == nil {
				err = look(ctx, client)
			}
		}
	}
	say("refused %v", err)
}
