// SPDX-License-Identifier: GPL-3.0-or-later
#ifdef OPENFOAM // not for the Foundation's OpenFOAM

#include "couplingLink.H"
#include "Time.H"
#include "displacementMotionSolver.H"
#include "fvcGrad.H"
#include "knownEntries.H"
#include "volFields.H"
#include <zmq.h>

Foam::couplingLink::couplingLink(const dictionary& dict)
:
    endpoint_(string(dict.get<string>("endpoint")).expand()),
    rho_(dict.get<scalar>("rho")),
    pRef_(dict.lookupOrDefault<scalar>("pRef", 0)),
    timeout_(int(1000*dict.lookupOrDefault<scalar>("timeout", 1800))),
    context_(zmq_ctx_new()),
    socket_(zmq_socket(context_, ZMQ_REQ)),
    sent_(-1),
    window_(-1),
    iteration_(0),
    maxCorrectors_(-1)
{
    checkEntries
    (
        dict,
        {"endpoint", "rho", "pRef", "timeout", "type", "patchType", "value"}
    );
    const int linger = 0;
    zmq_setsockopt(socket_, ZMQ_LINGER, &linger, sizeof(linger));
    zmq_setsockopt(socket_, ZMQ_RCVTIMEO, &timeout_, sizeof(timeout_));
    zmq_setsockopt(socket_, ZMQ_SNDTIMEO, &timeout_, sizeof(timeout_));
    if (Pstream::parRun())
    {
        FatalIOErrorInFunction(dict)
            << "coupledDisplacement works in serial runs only"
            << exit(FatalIOError);
    }
    if (zmq_connect(socket_, endpoint_.c_str()) != 0)
    {
        FatalIOErrorInFunction(dict)
            << "endpoint " << endpoint_ << ": " << zmq_strerror(zmq_errno())
            << exit(FatalIOError);
    }
}


Foam::couplingLink::~couplingLink()
{
    zmq_close(socket_);
    zmq_ctx_term(context_);
}


void Foam::couplingLink::call
(
    const string& head,
    const UList<const vectorField*>& arrays
)
{
    int rc = zmq_send
    (
        socket_, head.data(), head.size(), arrays.empty() ? 0 : ZMQ_SNDMORE
    );
    for (label i = 0; rc >= 0 && i < arrays.size(); ++i)
    {
        rc = zmq_send
        (
            socket_,
            arrays[i]->cdata(),
            arrays[i]->size()*sizeof(vector),
            i + 1 < arrays.size() ? ZMQ_SNDMORE : 0
        );
    }
    if (rc < 0)
    {
        FatalErrorInFunction
            << "the coupling driver at " << endpoint_
            << " cannot be asked: " << zmq_strerror(zmq_errno())
            << exit(FatalError);
    }
}


void Foam::couplingLink::receive(const label nPoints)
{
    char text[1024];
    const int length = zmq_recv(socket_, text, sizeof(text), 0);
    if (length < 0)
    {
        FatalErrorInFunction
            << "no answer of the coupling driver at " << endpoint_
            << " within " << timeout_/1000 << " s" << exit(FatalError);
    }
    reply_ = string(text, min(length, int(sizeof(text))));
    if (reply_.substr(0, 4) == "stop")
    {
        FatalErrorInFunction
            << "the coupling driver says " << reply_.c_str()
            << exit(FatalError);
    }
    int more = 0;
    std::size_t size = sizeof(more);
    zmq_getsockopt(socket_, ZMQ_RCVMORE, &more, &size);
    if (!more)
    {
        answer_.clear();
        return;
    }
    answer_.setSize(nPoints);
    const int bytes = nPoints*int(sizeof(vector));
    if (zmq_recv(socket_, answer_.data(), bytes, 0) != bytes)
    {
        FatalErrorInFunction
            << "the coupling driver at " << endpoint_ << " answers with "
            << "another number of displacements than the patch's points, "
            << nPoints << exit(FatalError);
    }
}


void Foam::couplingLink::hello(const polyMesh& mesh, const label patchi)
{
    const polyPatch& patch = mesh.boundaryMesh()[patchi];
    const pointField& points0 =
        mesh.lookupObject<displacementMotionSolver>("dynamicMeshDict").points0();
    const vectorField points(points0, patch.meshPoints());
    vectorField centres(patch.size());
    forAll(patch, i)
    {
        centres[i] = patch[i].centre(points0);
    }
    std::ostringstream head;
    head<< "hello 1 " << patch.name() << ' ' << points.size() << ' '
        << centres.size();
    call(head.str(), List<const vectorField*>({&points, &centres}));
    receive(0);
}


Foam::tmp<Foam::vectorField> Foam::couplingLink::forces
(
    const fvMesh& mesh,
    const label patchi
) const
{
    const auto& U = mesh.lookupObject<volVectorField>("U");
    const auto& p = mesh.lookupObject<volScalarField>("p");
    if (p.dimensions() != sqr(dimVelocity))
    {
        FatalErrorInFunction
            << "p has the dimensions " << p.dimensions() << ": forces are "
            << "computed from a kinematic pressure" << exit(FatalError);
    }
    scalarField nu
    (
        mesh.boundary()[patchi].size(),
        mesh.lookupObject<dictionary>("transportProperties")
            .get<dimensionedScalar>("nu").value()
    );
    if (mesh.foundObject<volScalarField>("nut"))
    {
        nu += mesh.lookupObject<volScalarField>("nut").boundaryField()[patchi];
    }
    const vectorField& Sf = mesh.Sf().boundaryField()[patchi];
    const tmp<volTensorField> gradU(fvc::grad(U));
    const tensorField& grad = gradU().boundaryField()[patchi];
    return
        rho_*
        (
            (p.boundaryField()[patchi] - pRef_)*Sf
          - nu*(Sf & dev(twoSymm(grad)))
        );
}


void Foam::couplingLink::setCorrectors
(
    const fvMesh& mesh,
    const label most
) const
{
    // pimpleControl reads it again at the head of each outer corrector
    const_cast<dictionary&>(mesh.solutionDict().subDict("PIMPLE"))
        .set("nOuterCorrectors", most);
}


bool Foam::couplingLink::due(const fvMesh& mesh) const
{
    // motion solvers may evaluate a boundary condition several times
    return
        mesh.time().timeIndex() > mesh.time().startTimeIndex()
     && mesh.lookupObject<volScalarField>("p").eventNo() != sent_;
}


const Foam::vectorField& Foam::couplingLink::exchange
(
    const fvMesh& mesh,
    const label patchi
)
{
    const Time& time = mesh.time();
    if (maxCorrectors_ < 0)
    {
        hello(mesh, patchi);
        maxCorrectors_ = mesh.solutionDict().subDict("PIMPLE")
            .lookupOrDefault<label>("nOuterCorrectors", 1);
    }
    if (time.timeIndex() != window_)
    {
        window_ = time.timeIndex();
        iteration_ = 0;
        setCorrectors(mesh, maxCorrectors_);
    }
    ++iteration_;
    std::ostringstream head;
    head.precision(17);
    head<< "window " << window_ << ' ' << iteration_ << ' ' << time.value()
        << ' ' << time.deltaTValue();
    const vectorField sent(forces(mesh, patchi));
    call(head.str(), List<const vectorField*>({&sent}));
    receive(mesh.boundaryMesh()[patchi].nPoints());
    if (reply_ == "final")
    {
        setCorrectors(mesh, iteration_);
    }
    sent_ = mesh.lookupObject<volScalarField>("p").eventNo();
    return answer_;
}


#endif
